//! Motion as arrays of the `ndarray` crate; views share the numbers.

use crate::format::positions::Positions;
use crate::{Clip, GlobalPose, Quat, Skeleton, Vec3};
use ndarray::{Array3, ArrayView2, ArrayView3};

fn vectors(all: &[Vec3]) -> &[f64] {
    bytemuck::cast_slice(all)
}

/// The shape is computed from the slice's length, so it always fits.
fn matrix(all: &[f64], columns: usize) -> ArrayView2<'_, f64> {
    ArrayView2::from_shape((all.len() / columns, columns), all).expect("whole rows")
}

fn rows(all: &[f64], columns: usize, width: usize) -> ArrayView3<'_, f64> {
    // a skeleton has a joint, but positions may be of none
    let rows = all.len() / (columns * width).max(1);
    ArrayView3::from_shape((rows, columns, width), all).expect("whole rows")
}

fn quaternions(all: &[Quat]) -> &[f64] {
    bytemuck::cast_slice(all)
}

impl Clip {
    /// Root positions (F, 3), metres, world.
    ///
    /// ```
    /// # use kinelm_motion::{Clip, Quat, Vec3, smpl};
    /// let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::new(1.0, 2.0, 3.0); 5], vec![Quat::IDENTITY; 5 * 24])?;
    /// assert_eq!(clip.root_view().shape(), [5, 3]);
    /// assert_eq!(clip.root_view()[(4, 1)], 2.0);
    /// assert_eq!(clip.rotations_view().shape(), [5, 24, 4]);
    /// assert_eq!(clip.rotations_view()[(4, 23, 3)], 1.0, "w is the last");
    /// # Ok::<(), kinelm_motion::Error>(())
    /// ```
    pub fn root_view(&self) -> ArrayView2<'_, f64> {
        matrix(vectors(self.root()), 3)
    }

    /// Local rotations (F, J, 4), unit quaternions in the order **x, y, z, w**.
    pub fn rotations_view(&self) -> ArrayView3<'_, f64> {
        rows(quaternions(self.rotations()), self.joints(), 4)
    }

    /// World positions of the joints (F, J, 3), metres.
    pub fn positions_array(&self) -> Array3<f64> {
        // the numbers move: no copy
        let numbers = bytemuck::allocation::cast_vec(self.positions());
        Array3::from_shape_vec((self.frames(), self.joints(), 3), numbers).expect("whole rows")
    }
}

impl Skeleton {
    /// Offsets from the parents (J, 3), metres.
    pub fn offsets_view(&self) -> ArrayView2<'_, f64> {
        matrix(vectors(self.offsets()), 3)
    }
}

impl GlobalPose {
    /// World positions of the joints (J, 3), metres.
    pub fn positions_view(&self) -> ArrayView2<'_, f64> {
        matrix(vectors(&self.positions), 3)
    }
}

impl Positions {
    /// World positions of joints and end sites (F, N, 3), metres. Positions after the last whole frame are dropped.
    pub fn view(&self) -> ArrayView3<'_, f64> {
        let n = self.joints.len();
        let whole = self.positions.len() / n.max(1) * n;
        rows(vectors(&self.positions[..whole]), n, 3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::smpl;
    use std::sync::Arc;

    #[test]
    fn views_hold_what_the_clip_holds() {
        let q = Quat::from_rotation_y(0.5);
        let root: Vec<Vec3> = (0..3).map(|f| Vec3::new(f as f64, 1.0, -1.0)).collect();
        let clip = Clip::new(smpl::neutral(), 20.0, root, vec![q; 72]).unwrap();
        assert_eq!(clip.root_view()[(2, 0)], 2.0);
        assert_eq!(clip.rotations_view()[(1, 7, 1)], q.y);
        let positions = Positions::from_clip(&clip);
        assert_eq!(positions.view().shape(), [3, 24, 3]);
        let pose = clip.global_pose(2);
        assert_eq!(pose.positions_view()[(23, 2)], positions.view()[(2, 23, 2)]);
        assert_eq!(pose.positions_view()[(23, 2)], pose.positions[23].z);
        assert_eq!(clip.positions_array(), positions.view());
        assert_eq!(clip.skeleton().offsets_view()[(7, 1)], clip.skeleton().offsets()[7].y);
    }

    #[test]
    fn views_of_nothing() {
        let clip = Clip::new(smpl::neutral(), 20.0, vec![], vec![]).unwrap();
        assert_eq!((clip.root_view().shape(), clip.rotations_view().shape()), (&[0, 3][..], &[0, 24, 4][..]));
        assert_eq!(
            Positions { joints: vec![], parents: vec![], fps: 1.0, positions: vec![] }.view().shape(),
            [0, 0, 3]
        );
        let odd =
            Positions { joints: vec!["a".into(); 2], parents: vec![-1; 2], fps: 1.0, positions: vec![Vec3::X; 3] };
        assert_eq!(odd.view().shape(), [1, 2, 3]);
        if let Ok(empty) = Skeleton::new(vec![], vec![], vec![], vec![]) {
            let clip = Clip::new(Arc::new(empty), 20.0, vec![Vec3::X; 2], vec![]).unwrap();
            assert_eq!(clip.rotations_view().len(), 0);
        }
    }
}
