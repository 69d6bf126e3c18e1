//! The extensions of a document that are read: those of VRM that name bones.

use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// The extensions of a document that name bones. Their other members are whatever they are.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Extensions {
    #[serde(rename = "VRM")]
    pub vrm_0: Option<Vrm>,
    #[serde(rename = "VRMC_vrm")]
    pub vrm_1: Option<Vrm>,
    #[serde(rename = "VRMC_vrm_animation")]
    pub animation: Option<Vrm>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Vrm {
    humanoid: Option<HumanBones>,
    pub expressions: Option<IgnoredAny>,
    pub look_at: Option<IgnoredAny>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct HumanBones {
    human_bones: Bones,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Bones {
    Listed(Vec<BoneOf>),
    Named(BTreeMap<String, Option<BoneOf>>),
}

impl Default for Bones {
    fn default() -> Bones {
        Bones::Listed(Vec::new())
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct BoneOf {
    /// Its name, where bones are listed.
    bone: String,
    /// -1 in files of VRM 0 for bones that a body lacks.
    node: Option<i64>,
}

impl Vrm {
    /// Names of bones with their nodes.
    pub fn bones(&self) -> Vec<(&str, i64)> {
        match self.humanoid.as_ref().map(|humanoid| &humanoid.human_bones) {
            Some(Bones::Listed(list)) => list.iter().filter_map(|of| Some((&*of.bone, of.node?))).collect(),
            Some(Bones::Named(map)) => {
                map.iter().filter_map(|(name, of)| Some((&**name, of.as_ref()?.node?))).collect()
            }
            None => Vec::new(),
        }
    }
}
