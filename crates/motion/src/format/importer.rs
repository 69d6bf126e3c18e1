//! Programs that import what is written, and what each expects of names, units and roots.

use super::Format;
use crate::{Clip, Error, Motion, Result, Skeleton, Vec3};
use std::collections::HashSet;
use std::sync::Arc;

/// A program that imports a motion file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Importer {
    /// Blender's importers of BVH and glTF: bone names of at most 63 bytes.
    Blender,
    /// three.js's `BVHLoader` and `GLTFLoader`: no blanks and none of `[ ] . : /` in names, which are parts of its paths to
    /// properties; OFFSETs are added to positions.
    Three,
    /// Unreal's Interchange: GLB alone; names of ASCII letters, digits and `_`.
    Unreal,
}

/// The longest name of a bone in Blender, bytes.
const BLENDER_NAME: usize = 63;

impl Importer {
    /// The formats that it reads and this crate writes.
    pub fn formats(self) -> &'static [Format] {
        match self {
            Importer::Blender | Importer::Three => &[Format::Bvh, Format::Glb],
            Importer::Unreal => &[Format::Glb],
        }
    }

    /// The bytes of a motion as the program expects them: of a BVH, metres, y up, and channels of position for the root
    /// alone, whose OFFSET is 0.
    ///
    /// # Errors
    /// [`Unsupported`](kinelm_store::Error::Unsupported) for a format that the program doesn't read; those of writing.
    pub fn to_bytes(self, name: &str, motion: &Motion, format: Format) -> Result<Vec<u8>> {
        if !self.formats().contains(&format) {
            let why = format!("it reads {:?}", self.formats());
            return Err(Error::unsupported(format!("{format:?} for {self:?}"), why));
        }
        let clip = self.fit(&motion.clip)?;
        match format {
            Format::Glb => super::glb::to_bytes(&[(name, &clip)]),
            _ => super::bvh::to_bytes_in(&Motion::new(&motion.path, clip), 1.0),
        }
    }

    /// The clip with names that the program doesn't change, each once, and a root whose offset is 0.
    ///
    /// # Errors
    /// Those of [`Skeleton::new`].
    pub fn fit(self, clip: &Clip) -> Result<Clip> {
        let own = clip.skeleton();
        let mut taken = HashSet::new();
        let names = own.names().iter().map(|name| self.unique(&self.name(name), &mut taken)).collect();
        let mut offsets = own.offsets().to_vec();
        offsets[0] = Vec3::ZERO;
        let skeleton = Skeleton::new(names, own.parents().to_vec(), offsets, own.ends().to_vec())?;
        clip.clone().with_skeleton(Arc::new(skeleton))
    }

    fn name(self, name: &str) -> String {
        let is_allowed = |c: char| match self {
            Importer::Blender => !c.is_control(),
            Importer::Three => !c.is_control() && !c.is_whitespace() && !"[].:/".contains(c),
            Importer::Unreal => c.is_ascii_alphanumeric() || c == '_',
        };
        name.chars().map(|c| if is_allowed(c) { c } else { '_' }).collect()
    }

    fn unique(self, name: &str, taken: &mut HashSet<String>) -> String {
        let most = if self == Importer::Blender { BLENDER_NAME } else { usize::MAX };
        let candidate = |number: usize| {
            let ending = if number == 1 { String::new() } else { format!("_{number}") };
            let mut end = name.len().min(most - ending.len());
            // the limit is in bytes: never cut within a character
            while !name.is_char_boundary(end) {
                end -= 1;
            }
            format!("{}{ending}", &name[..end])
        };
        let free = (1..).map(candidate).find(|name| !taken.contains(name)).unwrap_or_default();
        taken.insert(free.clone());
        free
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quat;

    fn clip(names: &[&str]) -> Clip {
        let parents = (0..names.len()).map(|j| j.checked_sub(1)).collect();
        let offsets = vec![Vec3::new(0.1, 0.9, 0.0); names.len()];
        let names: Vec<String> = names.iter().map(|&name| name.into()).collect();
        let n = names.len();
        let skeleton = Skeleton::new(names, parents, offsets, Vec::new()).unwrap();
        Clip::new(Arc::new(skeleton), 30.0, vec![Vec3::new(0.0, 1.0, 0.5); 2], vec![Quat::IDENTITY; 2 * n]).unwrap()
    }

    #[test]
    fn names_are_kept_where_the_program_keeps_them() {
        let clip = clip(&["mixamorig:Hips", "Bip01 Spine", "Thigh.L", "Thigh_L", "größe"]);
        let names = |importer: Importer| importer.fit(&clip).unwrap().skeleton().names().join(" | ");
        assert_eq!(names(Importer::Blender), "mixamorig:Hips | Bip01 Spine | Thigh.L | Thigh_L | größe");
        assert_eq!(names(Importer::Three), "mixamorig_Hips | Bip01_Spine | Thigh_L | Thigh_L_2 | größe");
        assert_eq!(names(Importer::Unreal), "mixamorig_Hips | Bip01_Spine | Thigh_L | Thigh_L_2 | gr__e");
    }

    #[test]
    fn long_names_are_cut_between_letters_and_stay_apart() {
        let long = "ö".repeat(40);
        let names = Importer::Blender.fit(&clip(&["a", &format!("{long}1"), &format!("{long}2")])).unwrap();
        let names = names.skeleton().names();
        assert_eq!(names[1], "ö".repeat(31));
        assert_eq!(names[2], format!("{}_2", "ö".repeat(30)));
    }

    #[test]
    fn a_bvh_is_in_metres_and_its_root_has_no_offset() {
        let motion = Motion::new("a.bvh", clip(&["hips", "spine"]));
        let text = String::from_utf8(Importer::Three.to_bytes("a", &motion, Format::Bvh).unwrap()).unwrap();
        assert!(text.contains("ROOT hips\n{\n  OFFSET 0.000000 0.000000 0.000000"), "{text}");
        assert!(text.contains("    OFFSET 0.100000 0.900000 0.000000"), "{text}");
        assert!(text.lines().last().unwrap().starts_with("0.000000 1.000000 0.500000 "), "{text}");
        assert!(Importer::Unreal.to_bytes("a", &motion, Format::Bvh).is_err());
    }
}
