//! Rates of clips, those of a folder judged together.

use super::doubts::{self, Doubt, Info, Outcome};
use super::{Known, Library};
use kinelm_motion::format::RateDoubts;
use std::collections::{BTreeMap, BTreeSet};

impl Library {
    /// Judges the rates of all clips that were read, those of a folder together; the ids of the clips whose doubt of it
    /// came, went or changed because of others.
    pub fn judge_rates(&self) -> Vec<String> {
        let mut inner = self.inner();
        let mut doubts = RateDoubts::default();
        let mut falls_not = Vec::new();
        for (id, known) in &inner.known {
            let Known::Read(outcome) = known else { continue };
            let Outcome::Ready(info) = &**outcome else { continue };
            doubts.add(id, info.rate.clone());
            if info.rate.doubt.is_none() {
                falls_not.extend(info.rate.group.clone().map(|group| (id.clone(), group)));
            }
        }
        let likely = falls_not.into_iter().filter_map(|(id, group)| Some((id, doubts.likely_fps(&group)?)));
        let now: BTreeMap<String, f64> = likely.collect();
        // compared as a whole: a clip that came may doubt others, one that went may settle them
        let before = std::mem::replace(&mut inner.doubted_rates, now.clone());
        let ids: BTreeSet<&String> = before.keys().chain(now.keys()).collect();
        ids.into_iter().filter(|id| before.get(*id) != now.get(*id)).cloned().collect()
    }

    /// The doubt of a clip's rate because of others in its folder.
    pub(super) fn folder_rate(&self, id: &str, info: &Info) -> Option<Doubt> {
        let likely_fps = self.inner().doubted_rates.get(id).copied();
        likely_fps.map(|fps| doubts::of_folder_rate(info, fps))
    }
}

#[cfg(test)]
mod tests {
    use crate::fixture;
    use crate::project::document::{ClipRecord, Reading};
    use kinelm_motion::{Clip, Vec3, synth};

    #[test]
    fn one_doubted_rate_doubts_its_folder() {
        let dance = synth::corpus(3, 1, 4.0, 60.0).unwrap().remove(0).clip;
        // falls in free fall at 60 frames a second, and says 240, as the others of its folder do
        let root = (0..240).map(|f| Vec3::Y * (30.0 - 4.9 * (f as f64 / 60.0).powi(2))).collect();
        let falls = Clip::new(dance.skeleton().clone(), 240.0, root, dance.rotations().to_vec()).unwrap();
        let still = vec![Vec3::Y; 240];
        let beside = Clip::new(dance.skeleton().clone(), 240.0, still, dance.rotations().to_vec()).unwrap();
        let clips = [("falls.bvh", falls), ("beside.bvh", beside), ("other.bvh", dance)];
        let dir = tempfile::tempdir().unwrap();
        let (project, library) = fixture::library(dir.path(), &clips);
        let record = |name: &str| -> ClipRecord {
            project.read(|d| d.clips.iter().find(|clip| clip.name.starts_with(name)).cloned()).unwrap()
        };
        let label = |name: &str| {
            let view = library.view(&record(name));
            let doubts = view["doubts"].as_array().unwrap().clone();
            let doubt = doubts.into_iter().find(|doubt| doubt["kind"] == "rate_doubted");
            doubt.map(|doubt| doubt["fix"]["label"].as_str().unwrap().to_owned())
        };
        assert_eq!((label("falls").as_deref(), label("beside")), (Some("Play it at 60 fps"), None));
        assert_eq!(library.judge_rates(), [record("beside").id]);
        assert_eq!(["falls", "beside"].map(label), ["falls", "beside"].map(|_| Some("Play it at 60 fps".to_owned())));
        assert_eq!((label("other"), library.judge_rates().len()), (None, 0));
        // once its true rate is stated, nothing is left that doubts the other
        let stated = Reading { fps_source: Some(60.0), ..Reading::default() };
        project.plain(library.restated(&record("falls").id, stated).unwrap()).unwrap();
        fixture::read(&project, &library);
        assert_eq!((library.judge_rates(), label("beside")), (vec![record("beside").id], None));
    }
}
