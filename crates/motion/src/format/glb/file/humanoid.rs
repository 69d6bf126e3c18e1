//! VRM's humanoid of a document: which nodes are its bones. VRM 0 lists them, VRM 1 and animations map names to nodes.

use super::document::Document;
use super::extensions::Extensions;
use crate::Result;
use crate::format::source::vrm::{bone, bone_of_vrm_0};

/// A file that is of VRM's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// An avatar that looks along -z.
    Vrm0,
    /// An avatar that looks along +z.
    Vrm1,
    /// An animation, of which faces and gaze are left out: whether there are any.
    Animation { has_face: bool },
}

/// The humanoid of a document.
#[derive(Debug)]
pub struct Humanoid {
    pub kind: Kind,
    /// Bones, by their place in [`bones`](crate::format::source::vrm::bones), with their nodes, each once.
    pub bones: Vec<(usize, usize)>,
}

impl Humanoid {
    /// The humanoid of a document; `None` for one that isn't of VRM's. Bones that VRM doesn't define are left out, and eyes,
    /// which a gaze moves.
    ///
    /// # Errors
    /// A bone at a node that isn't there.
    pub fn of(document: &Document) -> Result<Option<Humanoid>> {
        let Extensions { vrm_0, vrm_1, animation } = &document.json.extensions;
        let (kind, vrm) = match (vrm_1, vrm_0, animation) {
            (Some(vrm), ..) => (Kind::Vrm1, vrm),
            (None, Some(vrm), _) => (Kind::Vrm0, vrm),
            (None, None, Some(of)) => {
                (Kind::Animation { has_face: of.expressions.is_some() || of.look_at.is_some() }, of)
            }
            (None, None, None) => return Ok(None),
        };
        let of_name = if kind == Kind::Vrm0 { bone_of_vrm_0 } else { bone };
        let mut bones: Vec<(usize, usize)> = Vec::new();
        for (name, node) in vrm.bones() {
            let Some(bone) = of_name(name).filter(|_| node >= 0) else { continue };
            let node = usize::try_from(node).ok().filter(|&node| node < document.json.nodes.len());
            let node =
                node.ok_or_else(|| document.fault(format!("the bone {name} at no node"), "a node of the file"))?;
            // each bone and each node once (humanoid.md)
            if bones.iter().all(|own| own.0 != bone && own.1 != node) {
                bones.push((bone, node));
            }
        }
        bones.sort_unstable();
        Ok(Some(Humanoid { kind, bones }))
    }
}
