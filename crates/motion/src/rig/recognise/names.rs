//! What the name of a joint says: its part of the body, its side, and whether it is a joint of the body at all.
//!
//! Names are evidence and no more: each is split into words (`CC_Base_L_ThighTwist01` is l, thigh, twist), and a word
//! may stand for several joints, between which hierarchy and proportions decide. Limits: the words are English, those
//! of MikuMikuDance Japanese; names in other languages say nothing.

use super::super::map::without_namespace;

/// A side of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// +x in the reference pose.
    Left,
    /// -x.
    Right,
}

/// What kind of joint a name speaks of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A joint of the body, or a name that says nothing.
    Body,
    /// A twist, roll, share or corrective joint.
    Twist,
    /// A joint of a finger or of the palm.
    Finger,
    /// Eyes, jaw, hair and the rest of the head.
    Face,
    /// A target, pole or control.
    Ik,
    /// A tip, a prop, cloth or flesh.
    Extra,
}

/// SMPL ids, with how strongly a name speaks for each.
type Weights = &'static [(usize, f64)];

/// What a name says.
#[derive(Debug, Clone, PartialEq)]
pub struct Hint {
    /// Left or right, if the name says so.
    pub side: Option<Side>,
    /// The kind of joint.
    pub kind: Kind,
    /// SMPL ids of the left or middle body, with how strongly the name speaks for each, 0 to 1. Empty: it says nothing.
    pub parts: Weights,
    /// Whether the name says nothing else but side and number.
    pub plain: bool,
}

impl Hint {
    /// How strongly the name speaks for the SMPL joint `id`, with its side: -1 where it speaks for another one, 0 where it
    /// says nothing, to 1.
    pub fn agreement(&self, id: usize) -> f64 {
        let (left, side) = side_of(id);
        if self.side.is_some() && self.side != side {
            return -1.0;
        }
        // a hand may be all that a rig has of fingers
        if self.kind != Kind::Body && !(self.kind == Kind::Finger && left == 22) {
            return -1.0;
        }
        match self.parts.iter().find(|(part, _)| *part == left) {
            Some((_, weight)) => *weight * if self.plain { 1.0 } else { 0.95 },
            None if self.parts.is_empty() => 0.0,
            None => -1.0,
        }
    }
}

/// The SMPL joint of the left or middle body, and the side of `id`.
pub fn side_of(id: usize) -> (usize, Option<Side>) {
    match id {
        1 | 4 | 7 | 10 | 13 | 16 | 18 | 20 | 22 => (id, Some(Side::Left)),
        2 | 5 | 8 | 11 | 14 | 17 | 19 | 21 | 23 => (id - 1, Some(Side::Right)),
        _ => (id, None),
    }
}

/// Words that make a joint no joint of the body, longest first where one contains another.
const KINDS: &[(Kind, &[&str])] = &[
    (Kind::Ik, &["ik", "pole", "target", "effector", "ctrl", "control", "goal", "tgt", "mch", "master", "parent"]),
    (
        Kind::Twist,
        &["twist", "roll", "share", "sharebone", "corrective", "tweak", "rolling", "half", "bendy", "捩", "捩れ"],
    ),
    (
        Kind::Finger,
        &[
            "thumb",
            "index",
            "middle",
            "mid",
            "ring",
            "pinky",
            "little",
            "pinkie",
            "finger",
            "fingers",
            "metacarpal",
            "carpal",
            "palm",
            "digit",
            "fing",
            "in",
            "pointer",
            "proximal",
            "intermediate",
            "distal",
            "親指",
            "人指",
            "中指",
            "薬指",
            "小指",
        ],
    ),
    (
        Kind::Face,
        &[
            "eye", "eyes", "jaw", "tongue", "teeth", "tooth", "brow", "lip", "lips", "cheek", "face", "facial", "nose",
            "ear", "hair", "lash", "eyelid", "lid", "mouth", "chin", "forehead", "temple", "nostril", "目", "両目",
            "髪", "舌",
        ],
    ),
    (
        Kind::Extra,
        &[
            "end",
            "nub",
            "tip",
            "top",
            "leaf",
            "breast",
            "pectoral",
            "pec",
            "bust",
            "buttock",
            "glute",
            "butt",
            "skirt",
            "tail",
            "weapon",
            "prop",
            "holder",
            "attach",
            "attachment",
            "socket",
            "helper",
            "aux",
            "dummy",
            "camera",
            "sec",
            "cloth",
            "sleeve",
            "belt",
            "cape",
            "wing",
            "fin",
            "hoof",
            "paw",
            "feather",
            "front",
            "hind",
            "genital",
            "nipple",
            "belly",
            "stomach",
            "muscle",
            "bulge",
            "kneecap",
            "heel",
            "marker",
            "sphere",
            "site",
            "effectors",
            "gun",
            "interaction",
            "offset",
            "先",
            "キャンセル",
            "補助",
        ],
    ),
];

/// Runs of words and the SMPL joints that they speak for, longest first; the left one stands for both sides.
const PARTS: &[(&[&str], Weights)] = &[
    (&["upper", "leg"], &[(1, 1.0)]),
    (&["up", "leg"], &[(1, 1.0)]),
    (&["lower", "leg"], &[(4, 1.0)]),
    (&["low", "leg"], &[(4, 1.0)]),
    (&["upper", "arm"], &[(16, 1.0)]),
    (&["up", "arm"], &[(16, 1.0)]),
    (&["u", "arm"], &[(16, 1.0)]),
    (&["lower", "arm"], &[(18, 1.0)]),
    (&["low", "arm"], &[(18, 1.0)]),
    (&["fore", "arm"], &[(18, 1.0)]),
    (&["f", "arm"], &[(18, 1.0)]),
    (&["upper", "chest"], &[(9, 0.8), (6, 0.4)]),
    (&["lower", "back"], &[(3, 1.0), (6, 0.3)]),
    (&["upper", "back"], &[(9, 0.8), (6, 0.6)]),
    (&["lower", "neck"], &[(12, 1.0)]),
    (&["upper", "neck"], &[(12, 0.4), (15, 0.1)]),
    (&["lower", "torso"], &[(0, 0.7), (3, 0.6)]),
    (&["upper", "torso"], &[(9, 0.8), (6, 0.6)]),
    (&["hip", "joint"], &[(1, 0.1)]),
    (&["hand", "base"], &[(22, 0.8), (20, 0.3)]),
    (&["toe", "base"], &[(10, 1.0)]),
    (&["thigh"], &[(1, 1.0)]),
    (&["femur"], &[(1, 1.0)]),
    (&["buttock"], &[(1, 0.1)]),
    (&["hips"], &[(0, 1.0)]),
    (&["pelvis"], &[(0, 1.0)]),
    (&["hip"], &[(0, 0.7), (1, 0.7)]),
    (&["shin"], &[(4, 1.0)]),
    (&["calf"], &[(4, 1.0)]),
    (&["knee"], &[(4, 1.0)]),
    (&["tibia"], &[(4, 1.0)]),
    (&["crus"], &[(4, 1.0)]),
    (&["leg"], &[(4, 0.6), (1, 0.5)]),
    (&["foot"], &[(7, 0.7), (10, 0.5)]),
    (&["feet"], &[(7, 0.7), (10, 0.5)]),
    (&["ankle"], &[(7, 1.0)]),
    (&["toe"], &[(10, 1.0)]),
    (&["toes"], &[(10, 1.0)]),
    (&["ball"], &[(10, 1.0)]),
    (&["metatarsal"], &[(10, 0.5)]),
    (&["metatarsals"], &[(10, 0.5)]),
    (&["spine"], &[(3, 0.6), (6, 0.6), (9, 0.5), (0, 0.05), (12, 0.05), (15, 0.05)]),
    (&["abdomen"], &[(3, 0.8), (6, 0.6)]),
    (&["ab"], &[(3, 0.8), (6, 0.3)]),
    (&["waist"], &[(3, 0.8), (6, 0.3)]),
    (&["torso"], &[(3, 0.6), (6, 0.6), (9, 0.6)]),
    (&["back"], &[(3, 0.6), (6, 0.6), (9, 0.6)]),
    (&["chest"], &[(9, 0.8), (6, 0.6), (3, 0.3)]),
    (&["ribcage"], &[(9, 0.9), (6, 0.4)]),
    (&["thorax"], &[(9, 0.9), (6, 0.4)]),
    (&["neck"], &[(12, 1.0)]),
    (&["head"], &[(15, 1.0)]),
    (&["skull"], &[(15, 1.0)]),
    (&["collar"], &[(13, 1.0)]),
    (&["clavicle"], &[(13, 1.0)]),
    (&["clav"], &[(13, 1.0)]),
    (&["shoulder"], &[(13, 0.6), (16, 0.6)]),
    (&["shldr"], &[(16, 0.9)]),
    (&["humerus"], &[(16, 1.0)]),
    (&["arm"], &[(16, 0.9), (18, 0.2)]),
    (&["elbow"], &[(18, 1.0)]),
    (&["radius"], &[(18, 0.9)]),
    (&["ulna"], &[(18, 0.9)]),
    (&["hand"], HAND),
    (&["wrist"], WRIST),
    // vertebrae as Xsens names them, and the bones of MikuMikuDance
    (&["l", "5"], &[(3, 0.7)]),
    (&["l", "3"], &[(3, 0.5), (6, 0.5)]),
    (&["t", "12"], &[(6, 0.8)]),
    (&["t", "8"], &[(9, 0.8)]),
    (&["センター"], &[(0, 0.5)]),
    (&["腰"], &[(0, 0.6)]),
    (&["下半身"], &[(0, 0.5)]),
    (&["上半身"], &[(3, 0.8), (9, 0.3)]),
    (&["首"], &[(12, 1.0)]),
    (&["頭"], &[(15, 1.0)]),
    (&["肩"], &[(13, 1.0)]),
    (&["腕"], &[(16, 1.0)]),
    (&["ひじ"], &[(18, 1.0)]),
    (&["手首"], &[(20, 1.0)]),
    (&["足首"], &[(7, 1.0)]),
    (&["つま先"], &[(10, 1.0)]),
    (&["ひざ"], &[(4, 1.0)]),
    (&["足"], &[(1, 1.0)]),
    (&["cog"], &[(0, 0.6)]),
    (&["root"], &[(0, 0.2)]),
];

/// What the words wrist and hand speak for, and the latter on an arm that has both.
const WRIST: Weights = &[(20, 1.0)];
const HAND: Weights = &[(20, 0.7), (22, 0.5)];
const HAND_BEYOND: Weights = &[(22, 0.8)];

/// Words that say which side.
const SIDES: &[(&str, Side)] = &[
    ("l", Side::Left),
    ("left", Side::Left),
    ("lft", Side::Left),
    ("lt", Side::Left),
    ("左", Side::Left),
    ("r", Side::Right),
    ("right", Side::Right),
    ("rgt", Side::Right),
    ("rt", Side::Right),
    ("右", Side::Right),
];

/// What the names of a rig (J) say, each by itself.
pub fn hints(names: &[String]) -> Vec<Hint> {
    let words: Vec<Vec<String>> = names.iter().map(|name| words(name)).collect();
    let shared = shared_start(&words);
    let mut hints: Vec<Hint> =
        words.iter().map(|words| hint(&words[shared.min(words.len().saturating_sub(1))..])).collect();
    for side in [Some(Side::Left), Some(Side::Right), None] {
        let says = |hint: &Hint, part: Weights| hint.side == side && hint.kind == Kind::Body && hint.parts == part;
        // where a rig has wrists, its hands are the joints beyond them; else a hand is the wrist itself
        if hints.iter().any(|hint| says(hint, WRIST) && hint.plain) {
            hints.iter_mut().filter(|hint| says(hint, HAND)).for_each(|hint| hint.parts = HAND_BEYOND);
        }
    }
    hints
}

/// How many first words all names with more than one word share (`CC Base`, `Valve Biped Bip 01`).
fn shared_start(words: &[Vec<String>]) -> usize {
    let mut several = words.iter().filter(|w| w.len() > 1);
    let Some(first) = several.next() else { return 0 };
    let mut shared = first.len();
    let mut count = 1;
    for other in several {
        shared = shared.min(first.iter().zip(other).take_while(|(a, b)| a == b).count());
        count += 1;
    }
    // few names may share a first word by chance
    if count < 8 { 0 } else { shared }
}

fn hint(words: &[String]) -> Hint {
    let mut side = None;
    let mut rest: Vec<&str> = Vec::new();
    for word in words {
        match SIDES.iter().find(|(s, _)| s == word) {
            Some((_, s)) if side.is_none() => side = Some(*s),
            _ => rest.push(word),
        }
    }
    // L5 and L3 are vertebrae
    if rest.len() == 1 && rest[0].parse::<u32>().is_ok() && words.len() == 2 && words[0] == "l" {
        (side, rest) = (None, words.iter().map(String::as_str).collect());
    }
    let found = PARTS.iter().find(|(run, _)| rest.windows(run.len()).any(|w| w == *run));
    let (run, parts) = found.map_or((0, &[][..]), |(run, parts)| (run.len(), *parts));
    let plain = rest.iter().filter(|w| w.parse::<u64>().is_err()).count() <= run;
    let says = |kind: Kind| KINDS.iter().any(|(k, list)| *k == kind && rest.iter().any(|w| list.contains(w)));
    // the first kind that fits wins: the IK target of a twist joint is a control
    let kind = if says(Kind::Ik) {
        Kind::Ik
    } else if says(Kind::Twist) {
        Kind::Twist
    } else if says(Kind::Extra) {
        Kind::Extra
    } else if says(Kind::Face) {
        Kind::Face
    // fingers have sides; without one, "mid", "middle" or "in" may belong to a joint of the trunk
    } else if side.is_some() && says(Kind::Finger) {
        Kind::Finger
    } else {
        Kind::Body
    };
    Hint { side, kind, parts, plain }
}

/// The words of a name in lower case: split at everything that is no letter or digit, where a capital follows a small
/// letter, between letters and digits, and between Latin letters and others. Numbers lose their leading zeros.
fn words(name: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut open = false;
    let mut before: Option<char> = None;
    let own: Vec<char> = without_namespace(name).chars().collect();
    for (i, &c) in own.iter().enumerate() {
        if !c.is_alphanumeric() {
            (open, before) = (false, None);
            continue;
        }
        let next_small = own.get(i + 1).is_some_and(|n| n.is_lowercase());
        let starts = before.is_none_or(|b| {
            b.is_numeric() != c.is_numeric()
                || b.is_ascii() != c.is_ascii()
                || (c.is_uppercase() && (b.is_lowercase() || (b.is_uppercase() && next_small)))
        });
        if starts || !open {
            words.push(String::new());
            open = true;
        }
        if let Some(word) = words.last_mut() {
            word.extend(c.to_lowercase());
        }
        before = Some(c);
    }
    // LUArm and RFArm: two capitals in a row are one word so far, the side and the first letter of upper or fore
    for i in 1..words.len() {
        if words[i] == "arm" && matches!(words[i - 1].as_str(), "lu" | "lf" | "ru" | "rf") {
            let letter = words[i - 1].split_off(1);
            words.insert(i, letter);
        }
    }
    words.into_iter().flat_map(split_side).map(|w| trimmed(&w)).filter(|w| !w.is_empty()).collect()
}

fn trimmed(word: &str) -> String {
    if word.chars().all(|c| c.is_ascii_digit()) { word.trim_start_matches('0').to_owned() } else { word.to_owned() }
}

/// A word with its side before it (`leftfoot`, `lfemur`, `左足首`, `lthigh`) as two.
fn split_side(word: String) -> Vec<String> {
    let kinds = |rest: &str| rest.len() > 3 && KINDS.iter().any(|(_, list)| list.contains(&rest));
    let known = |rest: &str| PARTS.iter().any(|(run, _)| *run == [rest]) || kinds(rest) || is_joined(rest);
    // longer spellings follow shorter ones in SIDES: backwards, `left` is tried before `l`
    for (side, _) in SIDES.iter().rev() {
        let Some(rest) = word.strip_prefix(side).filter(|r| !r.is_empty()) else { continue };
        // one or two letters begin many words (`leg`, `root`): they are a side only before a known word
        if side.len() > 2 || known(rest) {
            return std::iter::once((*side).to_owned()).chain(split_joined(rest.to_owned())).collect();
        }
    }
    split_joined(word)
}

/// Runs of two words that are also written as one.
fn is_joined(word: &str) -> bool {
    split_joined(word.to_owned()).len() > 1
}

fn split_joined(word: String) -> Vec<String> {
    for (run, _) in PARTS.iter().filter(|(run, _)| run.len() == 2) {
        if run[1].len() > 1 && word == format!("{}{}", run[0], run[1]) {
            return run.iter().map(|w| (*w).to_owned()).collect();
        }
    }
    vec![word]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(name: &str) -> (Option<Side>, Kind, Option<usize>) {
        let hint = hint(&words(name));
        let best = hint.parts.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|p| p.0);
        (hint.side, hint.kind, best)
    }

    #[test]
    fn names_of_many_tools() {
        let (left, right) = (Some(Side::Left), Some(Side::Right));
        for (name, side, kind, part) in [
            ("mixamorig:LeftUpLeg", left, Kind::Body, Some(1)),
            ("LeftLeg", left, Kind::Body, Some(4)),
            ("RightToeBase", right, Kind::Body, Some(10)),
            ("Bip01 R Forearm", right, Kind::Body, Some(18)),
            ("ValveBiped.Bip01_L_Clavicle", left, Kind::Body, Some(13)),
            ("CC_Base_L_Thigh", left, Kind::Body, Some(1)),
            ("CC_Base_L_ThighTwist01", left, Kind::Twist, Some(1)),
            ("CC_Base_R_ElbowShareBone", right, Kind::Twist, Some(18)),
            ("lShldrBend", left, Kind::Body, Some(16)),
            ("lForearmTwist", left, Kind::Twist, Some(18)),
            ("upperarm_twist_01_l", left, Kind::Twist, Some(16)),
            ("ik_foot_root", None, Kind::Ik, Some(7)),
            ("J_Bip_L_UpperArm", left, Kind::Body, Some(16)),
            ("DEF-upper_arm.L.001", left, Kind::Body, Some(16)),
            ("lowerleg01.R", right, Kind::Body, Some(4)),
            ("lfemur", left, Kind::Body, Some(1)),
            ("rtibia", right, Kind::Body, Some(4)),
            ("lowerback", None, Kind::Body, Some(3)),
            ("LUArm", left, Kind::Body, Some(16)),
            ("RFArm", right, Kind::Body, Some(18)),
            ("RThumb", right, Kind::Finger, None),
            ("LeftInHandIndex", left, Kind::Finger, Some(20)),
            ("左足首", left, Kind::Body, Some(7)),
            ("右ひじ", right, Kind::Body, Some(18)),
            ("L5", None, Kind::Body, Some(3)),
            ("Head_End", None, Kind::Extra, Some(15)),
            ("eye_L", left, Kind::Face, None),
            ("xq17", None, Kind::Body, None),
        ] {
            assert_eq!(said(name), (side, kind, part), "{name}: {:?}", words(name));
        }
    }

    #[test]
    fn a_shared_prefix_says_nothing() {
        let names =
            ["Hip_Pelvis", "Hip_Spine", "Hip_Head", "Hip_Neck", "Hip_L_Leg", "Hip_R_Leg", "Hip_L_Foot", "Hip_R_Foot"];
        let hints = hints(&names.map(str::to_owned));
        assert_eq!(hints[2].parts[0].0, 15);
        assert_eq!((hints[4].side, hints[4].parts[0].0), (Some(Side::Left), 4));
    }
}
