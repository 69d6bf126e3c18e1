//! Skeleton maps: which joints of a rig correspond to which SMPL joints, as a TOML that users can write.

use crate::rotation::{Axis, EulerOrder};
use crate::{Error, FaultKind, FileError, Quat, Result, Skeleton, smpl};
use kinelm_store::SourcePos;
use kinelm_store::suggest::did_you_mean;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::LazyLock;
use toml::Spanned;

/// The built-in maps: name and text.
const SHIPPED: &[(&str, &str)] = &[
    ("smpl", include_str!("../../configs/smpl.toml")),
    ("cmu", include_str!("../../configs/cmu.toml")),
    ("cmu-acrnn", include_str!("../../configs/cmu-acrnn.toml")),
    ("bandai", include_str!("../../configs/bandai.toml")),
    ("mixamo", include_str!("../../configs/mixamo.toml")),
];

/// The name of maps of recognised rigs.
pub(crate) const RECOGNISED: &str = "recognised";

/// The SMPL joints that every map must have: pelvis, hips, knees, ankles, shoulders, elbows, wrists.
pub(crate) const REQUIRED: [usize; 13] = [0, 1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21];

/// Which joints of a rig correspond to which SMPL joints, and the rig's reference pose.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonMap {
    /// The map's name, such as `cmu`.
    pub name: String,
    /// The rigs that it is for.
    pub description: String,
    /// By SMPL id: candidate names in the rig, of which the first that exists is used; empty without a counterpart.
    joints: [Vec<String>; 24],
    /// Local rotations of the reference pose, by the rig's joint name; all others are identity.
    reference: Vec<(String, Quat)>,
}

impl SkeletonMap {
    /// The names of the built-in maps.
    pub fn names() -> impl Iterator<Item = &'static str> {
        SHIPPED.iter().map(|(name, _)| *name)
    }

    /// A built-in map by its name, one of [`SkeletonMap::names`].
    ///
    /// ```
    /// use kinelm_motion::rig::SkeletonMap;
    ///
    /// let map = SkeletonMap::builtin("bandai").expect("a built-in map");
    /// assert_eq!(map.joint(4), Some("LowerLeg_L"), "the left knee");
    /// ```
    pub fn builtin(name: &str) -> Option<Self> {
        SkeletonMap::shipped().iter().find(|map| map.name == name).cloned()
    }

    /// The built-in maps. Their texts are constants, so that each is parsed once.
    fn shipped() -> &'static [SkeletonMap] {
        static MAPS: LazyLock<Vec<SkeletonMap>> = LazyLock::new(|| {
            let parsed = |(name, text): &(&str, &str)| SkeletonMap::parse(text, Path::new(name)).ok();
            SHIPPED.iter().filter_map(parsed).collect()
        });
        &MAPS
    }

    /// Reads a map from a TOML file.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`] when it can't be read, else those of [`SkeletonMap::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let text = kinelm_store::input::text(path).map_err(Error::io(path))?;
        SkeletonMap::parse(&text, path)
    }

    /// A built-in map by its name, else the map in the file of that path; several lines are the TOML itself.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when it is neither, else those of [`SkeletonMap::load`].
    pub fn by_name_or_file(name_or_path: &str) -> Result<Self> {
        if let Some(map) = SkeletonMap::builtin(name_or_path) {
            return Ok(map);
        }
        if name_or_path.contains('\n') {
            return SkeletonMap::parse(name_or_path, Path::new("map"));
        }
        if !Path::new(name_or_path).exists() {
            let names: Vec<_> = SkeletonMap::names().collect();
            let hint = did_you_mean(name_or_path, names.iter().copied());
            let expected = format!("a file or one of {}{hint}", names.join(", "));
            return Err(Error::invalid_parameter("map", format!("{name_or_path:?}"), expected));
        }
        SkeletonMap::load(name_or_path)
    }

    /// Parses the TOML of a map; `path` is used in messages.
    ///
    /// # Errors
    /// [`FaultKind::MapBad`] with line and column: no TOML, an unknown key or SMPL joint, a required joint without a name,
    /// one rig joint for two SMPL joints, an invalid Euler order or rotation.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let at = |span: Option<Range<usize>>| place(text, path, span.map_or(0, |s| s.start));
        let file: File = toml::from_str(text).map_err(|e| {
            FileError::new(at(e.span()), FaultKind::MapBad, e.message().trim().replace('\n', ", "), "a skeleton map")
                .help(HELP)
        })?;
        let bad = |span: Range<usize>, found: String, expected: &str| -> Error {
            FileError::new(at(Some(span)), FaultKind::MapBad, found, expected).help(HELP).into()
        };
        if file.name.get_ref().trim().is_empty() {
            return Err(bad(file.name.span(), "an empty name".into(), "a short one such as \"my-rig\""));
        }
        let joints_at = file.joints.span();
        let entries = file.joints.into_inner().by_id();
        if let Some(&id) = REQUIRED.iter().find(|&&id| entries[id].is_none()) {
            let (missing, required) = (smpl::NAMES[id], REQUIRED.map(|id| smpl::NAMES[id]).join(", "));
            return Err(bad(joints_at, format!("no {missing}"), &format!("at least {required}")));
        }
        let mut joints: [Vec<String>; 24] = Default::default();
        for (id, entry) in entries.into_iter().enumerate() {
            let Some(entry) = entry else { continue };
            let (span, names) = (entry.span(), entry.into_inner().list());
            if names.is_empty() || names.iter().any(|n| n.trim().is_empty()) {
                return Err(bad(span, "an empty name".into(), "a joint of the rig, or several to try in turn"));
            }
            // a rig's joint can't move two SMPL joints: retargeting back would have two answers for it
            if let Some((other, name)) =
                names.iter().find_map(|n| Some((joints.iter().position(|j| j.contains(n))?, n)))
            {
                let found = format!("{name} for {} and for {}", smpl::NAMES[other], smpl::NAMES[id]);
                return Err(bad(span, found, "one SMPL joint for a joint of the rig"));
            }
            joints[id] = names;
        }
        let reference = match file.reference {
            Some(r) => r.rotations(&bad)?,
            None => Vec::new(),
        };
        Ok(SkeletonMap { name: file.name.into_inner(), description: file.description, joints, reference })
    }

    /// The map of a rig whose joints by SMPL id are known, with the local rotations (J) of its reference pose; an empty
    /// slice stands for the rest pose.
    pub(super) fn of_joints(rig: &Skeleton, joints: &[Option<usize>; 24], reference: &[Quat]) -> Self {
        let name = |j: &Option<usize>| j.map(|j| rig.names()[j].clone()).into_iter().collect();
        let map = SkeletonMap {
            name: RECOGNISED.into(),
            description: "by shape and names".into(),
            joints: std::array::from_fn(|id| name(&joints[id])),
            reference: Vec::new(),
        };
        map.with_reference(rig, reference)
    }

    /// The map under another name.
    pub(super) fn described(self, name: &str, description: &str) -> Self {
        SkeletonMap { name: name.into(), description: description.into(), ..self }
    }

    /// The map with these local rotations (J) as its reference pose; an empty slice stands for the rest pose.
    pub(super) fn with_reference(self, rig: &Skeleton, reference: &[Quat]) -> Self {
        let turned = reference.iter().enumerate().filter(|(_, q)| **q != Quat::IDENTITY);
        SkeletonMap { reference: turned.map(|(j, q)| (rig.names()[j].clone(), *q)).collect(), ..self }
    }

    /// Whether it has a reference pose of its own.
    pub(super) fn has_reference(&self) -> bool {
        !self.reference.is_empty()
    }

    /// The built-in maps that fit a rig with these joint names, each with all required joints: those that find more joints
    /// first. [`SkeletonMap::joint`] of them gives the rig's own names.
    pub fn fitting(names: &[String]) -> Vec<Self> {
        let names = RigNames::new(names);
        let bound = |map: &SkeletonMap| {
            let bound = map.bound(&names);
            // of maps that find as many joints, the one whose own spelling the rig uses
            let exact = (0..24).filter(|&id| bound.joints[id].iter().any(|n| map.joints[id].contains(n))).count();
            bound.has_required().then_some(((bound.count(), exact), bound))
        };
        let mut found: Vec<_> = SkeletonMap::shipped().iter().filter_map(bound).collect();
        found.sort_by(|(a, _), (b, _)| b.cmp(a));
        found.into_iter().map(|(_, map)| map).collect()
    }

    /// The rig's joints by SMPL id.
    pub(crate) fn joints_of(&self, rig: &Skeleton) -> [Option<usize>; 24] {
        let bound = self.bind_any(rig.names());
        std::array::from_fn(|id| bound.joint(id).and_then(|name| rig.find(name)))
    }

    /// Local rotations (J) of the rig in the reference pose. A map serves rigs with and without fingers or toes, so joints
    /// that the rig hasn't are left out.
    pub(crate) fn local_reference(&self, rig: &Skeleton) -> Vec<Quat> {
        let mut local = vec![Quat::IDENTITY; rig.joints()];
        for (name, rotation) in self.reference() {
            if let Some(j) = rig.find(name) {
                local[j] = rotation;
            }
        }
        local
    }

    /// The rig's name of an SMPL joint; `None` without a counterpart or for ids above 23. A map that is not bound to a rig
    /// ([`SkeletonMap::bind`]) gives its first candidate.
    pub fn joint(&self, smpl_id: usize) -> Option<&str> {
        self.joints.get(smpl_id)?.first().map(String::as_str)
    }

    /// Local rotations of the rig's reference pose, a T-pose or A-pose facing +z, by joint name. Other joints are identity.
    pub fn reference(&self) -> impl Iterator<Item = (&str, Quat)> {
        self.reference.iter().map(|(name, q)| (name.as_str(), *q))
    }

    /// The map with the rig's own spelling: exact names first, then names that differ in letter case, in `_ - .`, blanks or
    /// a prefix that the rig's joints share (`mixamorig:`). `None` if a required joint is missing.
    pub fn bind(&self, names: &[String]) -> Option<Self> {
        Some(self.bind_any(names)).filter(SkeletonMap::has_required)
    }

    /// Like [`SkeletonMap::bind`], but required joints may be missing.
    pub fn bind_any(&self, names: &[String]) -> Self {
        self.bound(&RigNames::new(names))
    }

    fn bound(&self, names: &RigNames) -> Self {
        let mut best = self.bound_with(names, "");
        // a prefix is looked for only where it could find more
        if best.count() == self.count() {
            return best;
        }
        for pelvis in self.joints[0].iter().map(|n| simplified(n)) {
            for prefix in names.plain.iter().filter_map(|n| n.strip_suffix(&*pelvis)) {
                let bound = self.bound_with(names, prefix);
                if bound.count() > best.count() {
                    best = bound;
                }
            }
        }
        best
    }

    fn bound_with(&self, names: &RigNames, prefix: &str) -> Self {
        let mut used = vec![false; names.own.len()];
        let mut take = |candidate: &String| {
            let found = names.find(candidate, prefix).filter(|&j| !used[j])?;
            // each joint once: a candidate of a later SMPL joint must not take it again
            used[found] = true;
            Some(names.own[found].clone())
        };
        let joints =
            self.joints.each_ref().map(|candidates| candidates.iter().find_map(&mut take).into_iter().collect());
        let own = |(joint, q): &(String, Quat)| {
            (names.find(joint, prefix).map_or_else(|| joint.clone(), |j| names.own[j].clone()), *q)
        };
        let reference = self.reference.iter().map(own).collect();
        SkeletonMap { name: self.name.clone(), description: self.description.clone(), joints, reference }
    }

    /// How many SMPL joints have a counterpart.
    fn count(&self) -> usize {
        self.joints.iter().filter(|names| !names.is_empty()).count()
    }

    fn has_required(&self) -> bool {
        REQUIRED.iter().all(|&id| !self.joints[id].is_empty())
    }

    /// The map as TOML, as [`SkeletonMap::parse`] reads it.
    pub fn to_toml(&self) -> String {
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let mut out =
            format!("name = {}\ndescription = {}\n\n[joints]\n", quoted(&self.name), quoted(&self.description));
        for (id, names) in self.joints.iter().enumerate() {
            match names.as_slice() {
                [] => {}
                [one] => out += &format!("{} = {}\n", smpl::NAMES[id], quoted(one)),
                several => {
                    let list: Vec<String> = several.iter().map(|n| quoted(n)).collect();
                    out += &format!("{} = [{}]\n", smpl::NAMES[id], list.join(", "));
                }
            }
        }
        if !self.reference.is_empty() {
            out += "\n[reference]\norder = \"ZXY\"\n\n[reference.rotations]\n";
        }
        // any order would do: `parse` reads it back from the file
        let order = EulerOrder::new([Axis::Z, Axis::X, Axis::Y]);
        for (name, q) in &self.reference {
            let degrees = order.map_or([0.0; 3], |o| o.from_quat(*q, 0.0).map(f64::to_degrees));
            out += &format!("{} = [{:?}, {:?}, {:?}]\n", quoted(name), degrees[0], degrees[1], degrees[2]);
        }
        out
    }

    /// The required SMPL joints that a rig with these joint names lacks under this map.
    pub fn missing(&self, names: &[String]) -> Vec<&'static str> {
        let bound = self.bind_any(names);
        REQUIRED.iter().filter(|&&id| bound.joints[id].is_empty()).map(|&id| smpl::NAMES[id]).collect()
    }
}

/// The names of a rig's joints in the spellings that are compared.
struct RigNames<'a> {
    own: &'a [String],
    /// Without namespace.
    bare: Vec<&'a str>,
    /// [Simplified](simplified).
    plain: Vec<String>,
}

impl<'a> RigNames<'a> {
    fn new(own: &'a [String]) -> Self {
        let bare = own.iter().map(|name| without_namespace(name)).collect();
        RigNames { own, bare, plain: own.iter().map(|name| simplified(name)).collect() }
    }

    /// Finds a joint by its exact name, else without namespaces, else by its simplified name.
    fn find(&self, candidate: &str, prefix: &str) -> Option<usize> {
        let bare = without_namespace(candidate);
        let exact = self.own.iter().position(|name| name == candidate);
        exact.or_else(|| self.bare.iter().position(|name| *name == bare)).or_else(|| {
            let simple = simplified(candidate);
            self.plain.iter().position(|name| name.strip_prefix(prefix) == Some(&simple))
        })
    }
}

/// A name without its namespace, which ends at the last colon.
pub(crate) fn without_namespace(name: &str) -> &str {
    name.rsplit(':').next().unwrap_or(name)
}

/// A name without its namespace, letter case and separators.
fn simplified(name: &str) -> String {
    let own = without_namespace(name).chars();
    own.filter(|c| !matches!(c, '_' | '-' | '.') && !c.is_whitespace()).flat_map(char::to_lowercase).collect()
}

const HELP: &str = "see docs/skeletons.md";

fn place(text: &str, path: &Path, byte: usize) -> SourcePos {
    // serde's spans are bytes, a position's columns are characters; a span past the end means the end
    let before = text.get(..byte).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |i| i + 1);
    SourcePos {
        path: path.to_owned(),
        line: before.matches('\n').count() + 1,
        column: before[line_start..].chars().count() + 1,
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: Spanned<String>,
    #[serde(default)]
    description: String,
    joints: Spanned<Joints>,
    reference: Option<Reference>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a joint's name, or a list of names to try in turn")]
enum Names {
    One(String),
    Several(Vec<String>),
}

impl Names {
    fn list(self) -> Vec<String> {
        match self {
            Names::One(name) => vec![name],
            Names::Several(names) => names,
        }
    }
}

macro_rules! joints {
    ($($name:ident)*) => {
        /// A field per SMPL joint, so that serde reports an unknown name at its position with the list of valid ones.
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Joints { $($name: Option<Spanned<Names>>,)* }

        impl Joints {
            fn by_id(self) -> [Option<Spanned<Names>>; 24] {
                [$(self.$name),*]
            }
        }
    };
}

joints! {
    pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 left_foot right_foot
    neck left_collar right_collar head left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist
    left_hand right_hand
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Reference {
    order: Spanned<String>,
    rotations: BTreeMap<String, Spanned<[f64; 3]>>,
}

impl Reference {
    fn rotations(self, bad: &dyn Fn(Range<usize>, String, &str) -> Error) -> Result<Vec<(String, Quat)>> {
        let order = euler_order(self.order.get_ref()).ok_or_else(|| {
            bad(self.order.span(), format!("the order {:?}", self.order.get_ref()), "three axes such as \"ZXY\"")
        })?;
        let rotation = |(joint, angles): (String, Spanned<[f64; 3]>)| {
            let degrees = *angles.get_ref();
            if degrees.iter().any(|a| !a.is_finite()) {
                return Err(bad(angles.span(), format!("{degrees:?} for {joint}"), "three finite angles in degrees"));
            }
            Ok((joint, order.to_quat(degrees.map(f64::to_radians))))
        };
        self.rotations.into_iter().map(rotation).collect()
    }
}

fn euler_order(text: &str) -> Option<EulerOrder> {
    let axes: Option<Vec<Axis>> = text
        .chars()
        .map(|c| match c.to_ascii_uppercase() {
            'X' => Some(Axis::X),
            'Y' => Some(Axis::Y),
            'Z' => Some(Axis::Z),
            _ => None,
        })
        .collect();
    EulerOrder::new(axes?.try_into().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &str) -> Vec<String> {
        list.split(' ').map(str::to_owned).collect()
    }

    fn detected(list: &str) -> Option<String> {
        SkeletonMap::fitting(&names(list)).into_iter().next().map(|m| m.name)
    }

    const MIXAMO: &str = "Hips Spine Spine1 Spine2 Neck Head LeftShoulder LeftArm LeftForeArm LeftHand RightShoulder \
        RightArm RightForeArm RightHand LeftUpLeg LeftLeg LeftFoot LeftToeBase RightUpLeg RightLeg RightFoot RightToeBase";
    const CMU: &str = "Hips LHipJoint LeftUpLeg LeftLeg LeftFoot LeftToeBase RHipJoint RightUpLeg RightLeg RightFoot \
        RightToeBase LowerBack Spine Spine1 Neck Neck1 Head LeftShoulder LeftArm LeftForeArm LeftHand LeftFingerBase \
        LeftHandIndex1 LThumb RightShoulder RightArm RightForeArm RightHand RightFingerBase RightHandIndex1 RThumb";

    #[test]
    fn every_shipped_map_parses_and_bears_its_name() {
        for &(name, text) in SHIPPED {
            let map = SkeletonMap::parse(text, Path::new(name)).unwrap();
            assert_eq!(map.name, name);
            assert!(!map.description.is_empty());
        }
        assert!(SkeletonMap::builtin("ballerina").is_none());
        assert!(SkeletonMap::by_name_or_file("ballerina").unwrap_err().to_string().contains("cmu-acrnn"));
        let message = SkeletonMap::by_name_or_file("miximo").unwrap_err().to_string();
        assert!(message.ends_with("; did you mean mixamo?"), "{message}");
    }

    #[test]
    fn a_map_is_written_and_read_again() {
        let mut map = SkeletonMap::builtin("bandai").unwrap();
        map.joints[10] = vec!["a \"b\"".into(), "ü".into()];
        let again = SkeletonMap::parse(&map.to_toml(), Path::new("again")).unwrap();
        assert_eq!((&again.name, &again.joints), (&map.name, &map.joints));
        let (mut a, mut b) = (again.reference, map.reference);
        a.sort_by(|x, y| x.0.cmp(&y.0));
        b.sort_by(|x, y| x.0.cmp(&y.0));
        for ((joint, q), (other, p)) in a.iter().zip(&b) {
            assert!(joint == other && crate::rotation::angle_between(*q, *p) < 1e-12, "{joint} {other}");
        }
    }

    #[test]
    fn rigs_are_known_by_their_names() {
        assert_eq!(detected(CMU).unwrap(), "cmu");
        assert_eq!(detected(MIXAMO).unwrap(), "mixamo");
        assert_eq!(detected(&smpl::NAMES.join(" ")).unwrap(), "smpl");
        let f_avg = "f_avg_root f_avg_Pelvis f_avg_L_Hip f_avg_L_Knee f_avg_L_Ankle f_avg_R_Hip f_avg_R_Knee \
            f_avg_R_Ankle f_avg_L_Shoulder f_avg_L_Elbow f_avg_L_Wrist f_avg_R_Shoulder f_avg_R_Elbow f_avg_R_Wrist";
        assert_eq!(detected(f_avg).unwrap(), "smpl");
        assert_eq!(detected("a b c"), None);
        assert_eq!(detected(&MIXAMO.replace("LeftLeg", "LeftTail")), None);
    }

    #[test]
    fn prefixes_and_case_are_seen_through() {
        for prefix in ["mixamorig:", "mixamorig1:", "MixamoRig_", "Bob:mixamorig:", "bob "] {
            let rig: Vec<_> = names(MIXAMO).iter().map(|n| format!("{prefix}{n}")).collect();
            let map = SkeletonMap::fitting(&rig).remove(0);
            assert_eq!(map.name, "mixamo", "{prefix}");
            assert_eq!(map.joint(0).unwrap(), format!("{prefix}Hips"));
            assert_eq!(map.joint(20).unwrap(), format!("{prefix}LeftHand"));
            assert_eq!(map.joint(22), None);
        }
        let loud = SkeletonMap::fitting(&names(&CMU.to_uppercase())).remove(0);
        assert_eq!((loud.name.as_str(), loud.joint(4)), ("cmu", Some("LEFTLEG")));
        // the letter case decides if both spellings exist
        let two = SkeletonMap::fitting(&names(&format!("HIPS {MIXAMO}"))).remove(0);
        assert_eq!(two.joint(0), Some("Hips"));
    }

    #[test]
    fn what_a_rig_lacks_is_listed() {
        let map = SkeletonMap::builtin("mixamo").unwrap();
        let rig = names(&MIXAMO.replace(" LeftLeg", "").replace(" RightHand", ""));
        assert_eq!(map.missing(&rig), ["left_knee", "right_wrist"]);
    }

    #[test]
    fn errors_have_their_place() {
        let good = SHIPPED.iter().find(|(name, _)| *name == "bandai").unwrap().1;
        let fails = |text: &str| {
            let e = SkeletonMap::parse(text, Path::new("my.toml")).unwrap_err();
            assert_eq!(e.fault(), Some(FaultKind::MapBad), "{e}");
            e.to_string()
        };
        let line = |s: &str| good.lines().position(|l| l.starts_with(s)).unwrap() + 1;
        let e = fails(&good.replace("head =", "hat ="));
        assert!(e.starts_with(&format!("my.toml:{}:1: map_bad", line("head"))) && e.contains("`hat`"), "{e}");
        let e = fails(&good.replace("left_knee = \"LowerLeg_L\"\n", ""));
        assert!(e.contains("no left_knee") && e.contains("right_wrist"), "{e}");
        let e = fails(&good.replace("\"UpperLeg_R\"", "\"UpperLeg_L\""));
        assert!(e.starts_with(&format!("my.toml:{}:13: ", line("right_hip"))), "{e}");
        assert!(e.contains("UpperLeg_L for left_hip and for right_hip"), "{e}");
        assert!(fails(&good.replace("\"Neck\"", "7")).contains("a joint's name"), "type");
        assert!(fails(&good.replace("\"Neck\"", "[]")).contains("empty"));
        assert!(fails("name = \"x\"").contains("joints"));
        assert!(fails("name = ").contains("my.toml:1:"));
        assert!(fails(&good.replace("\"ZXY\"", "\"ZZY\"")).contains("ZZY"));
        assert!(fails(&good.replace("name = \"bandai\"", "name = \"\"")).contains("empty name"));
    }
}
