//! Where a dance stands: coding takes the place of the first frame off, and a free root starts facing anywhere.

use super::followed::Followed;
use super::request::Place;
use crate::Result;
use kinelm_motion::rotation::heading;
use kinelm_motion::{Clip, Quat, Vec3};

/// What of the root's first frame a dance's words say as the prompt's do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Led {
    /// The translation: its steps are the prompt's.
    pub place: bool,
    /// The pelvis's heading.
    pub heading: bool,
}

impl Led {
    /// By what is followed of a prompt.
    pub fn by(prompt: &Followed) -> Led {
        let begins = !prompt.beginning.is_empty();
        let place = begins || prompt.selection.as_ref().is_some_and(|s| s.translation);
        Led { place, heading: place || prompt.selection.as_ref().is_some_and(|s| s.joints.contains(&0)) }
    }
}

impl Place {
    /// A dance, as decoded, moved and turned to stand here. What the words say as the prompt's do is left as it is, but for
    /// the place that coding took off.
    ///
    /// # Errors
    /// None that a decoded clip brings about.
    pub fn put(&self, dance: &Clip, led: Led) -> Result<Clip> {
        let Some(first) = dance.root().first().map(|p| Vec3::new(p.x, 0.0, p.z)) else { return Ok(dance.clone()) };
        let faces = heading(dance.pose(0)[0]);
        let turn = self.heading.zip(faces).map_or(0.0, |(wanted, found)| wanted - found);
        let turn = if led.heading { Quat::IDENTITY } else { Quat::from_rotation_y(turn) };
        let (from, to) = (if led.place { Vec3::ZERO } else { first }, Vec3::new(self.x, 0.0, self.z));
        let root = dance.root().iter().map(|p| turn * (*p - from) + to).collect();
        let mut rotations = dance.rotations().to_vec();
        rotations.iter_mut().step_by(dance.joints()).for_each(|pelvis| *pelvis = turn * *pelvis);
        Ok(Clip::new(dance.skeleton().clone(), dance.fps(), root, rotations)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth;

    fn dance() -> Clip {
        synth::corpus(4, 1, 2.0, 20.0).unwrap().remove(0).clip
    }

    #[test]
    fn a_free_root_is_put_to_the_place_and_faces_as_the_prompt() {
        let (dance, there) = (dance(), Place { x: 3.0, z: -2.0, heading: Some(2.5) });
        let put = there.put(&dance, Led { place: false, heading: false }).unwrap();
        let found = Place::of(&put).unwrap();
        assert!((found.x - 3.0).abs() < 1e-12 && (found.z + 2.0).abs() < 1e-12, "{found:?}");
        assert!((found.heading.unwrap() - 2.5).abs() < 1e-12, "{found:?}");
        // a turn and a shift of the whole: places among themselves, heights and all other rotations stay
        let (a, b) = (dance.positions(), put.positions());
        for (i, j) in [(0, 23), (5, a.len() - 1), (24, a.len() / 2)] {
            assert!(((a[i] - a[j]).length() - (b[i] - b[j]).length()).abs() < 1e-9);
            assert!((a[i].y - b[i].y).abs() < 1e-9);
        }
    }

    #[test]
    fn what_the_codes_say_of_the_root_stays() {
        let (dance, there) = (dance(), Place { x: 3.0, z: -2.0, heading: Some(2.5) });
        let put = there.put(&dance, Led { place: true, heading: true }).unwrap();
        assert_eq!(put.rotations(), dance.rotations());
        let off = |f: usize| put.root()[f] - dance.root()[f] - Vec3::new(3.0, 0.0, -2.0);
        assert!((0..dance.frames()).all(|f| off(f).length() < 1e-12));
        let turned = there.put(&dance, Led { place: false, heading: true }).unwrap();
        assert_eq!((turned.rotations(), turned.root()[0].x), (dance.rotations(), 3.0));
        assert_eq!(there.put(&dance.slice(0..0), Led { place: true, heading: true }).unwrap().frames(), 0);
    }
}
