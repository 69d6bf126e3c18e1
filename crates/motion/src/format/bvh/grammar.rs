//! The grammar of a hierarchy: docs/motion-files.md.

use super::text::{BadNumber, Text, number, word_at};
use crate::format::source::bvh::{Channel, Header, Node, NodeKind};
use crate::{FaultKind, FileError};
use std::collections::HashMap;

/// Nested braces that a reader accepts.
pub(crate) const MAX_DEPTH: usize = 512;
/// Joints of all roots together that a reader accepts.
pub(crate) const MAX_JOINTS: usize = 4096;

/// Parses everything before the rows.
pub(crate) fn parse(text: &Text, lenient: bool) -> Result<Header, FileError> {
    let mut p = Parser {
        text: *text,
        at: text.start(),
        nodes: Vec::new(),
        open: Vec::new(),
        joints: 0,
        width: 0,
        seen: HashMap::new(),
        oddities: Oddities::default(),
    };
    p.hierarchy()?;
    p.motion(lenient)
}

/// A node whose `}` has not been parsed yet.
struct Open {
    node: usize,
    brace: usize,
    offset: bool,
    channels: bool,
    child: bool,
}

/// Oddities, collected so that a thousand of one kind make one warning.
#[derive(Default)]
pub(super) struct Oddities {
    pub comments: Vec<usize>,
    pub twice: Vec<String>,
    pub tipless: Vec<String>,
    pub channelless: Vec<String>,
}

pub(super) struct Parser<'a> {
    pub text: Text<'a>,
    pub at: usize,
    pub nodes: Vec<Node>,
    open: Vec<Open>,
    joints: usize,
    pub width: usize,
    seen: HashMap<String, usize>,
    pub oddities: Oddities,
}

pub(super) type Step<T = ()> = Result<T, FileError>;

impl<'a> Parser<'a> {
    pub fn byte(&self) -> Option<u8> {
        self.text.bytes.get(self.at).copied()
    }

    pub fn blanks(&mut self) {
        while matches!(self.byte(), Some(b' ' | b'\t')) {
            self.at += 1;
        }
    }

    /// Skips blanks, line ends and, if allowed here, comment lines.
    pub fn skip(&mut self, comments: bool) {
        loop {
            match self.byte() {
                Some(b' ' | b'\t' | b'\r' | b'\n') => self.at += 1,
                Some(b'#' | b'/') if comments && self.at_comment() => {
                    self.oddities.comments.push(self.at);
                    while !matches!(self.byte(), None | Some(b'\r' | b'\n')) {
                        self.at += 1;
                    }
                }
                _ => return,
            }
        }
    }

    fn at_comment(&self) -> bool {
        let (before, rest) = self.text.bytes.split_at(self.at);
        let first = before[self.text.start()..].iter().rev().find(|b| !matches!(b, b' ' | b'\t'));
        matches!(first, None | Some(b'\r' | b'\n')) && (rest[0] == b'#' || rest.starts_with(b"//"))
    }

    /// The next word or brace with its position; empty at the end of the file.
    fn word(&mut self, comments: bool) -> (usize, &'a [u8]) {
        self.skip(comments);
        let at = self.at;
        let word = match self.byte() {
            Some(b'{' | b'}') => &self.text.bytes[at..at + 1],
            _ => word_at(self.text.bytes, at),
        };
        self.at += word.len();
        (at, word)
    }

    pub fn unexpected(&self, at: usize, expected: impl Into<String>) -> FileError {
        let fault = self.text.fault(at, FaultKind::UnexpectedWord, self.text.found(at), expected);
        match self.text.bytes.get(at) {
            None => fault.help("the file may be cut: fetch it again"),
            Some(_) => fault.help("mend the header there"),
        }
    }

    fn label(&self, node: usize) -> String {
        let n = &self.nodes[node];
        match n.kind {
            NodeKind::End => match n.parent.map(|p| &self.nodes[p].unique) {
                Some(parent) => format!("the end site of {parent:?}"),
                None => "an end site".into(),
            },
            _ => format!("{:?}", n.unique),
        }
    }

    fn hierarchy(&mut self) -> Step {
        let (at, word) = self.word(true);
        if !word.eq_ignore_ascii_case(b"HIERARCHY") {
            let looks = crate::format::sniff(self.text.bytes);
            let found = if word.is_empty() { self.text.found(at) } else { self.text.quote(word) };
            let fault = self.text.fault(at, FaultKind::NotBvh, found, "HIERARCHY as the first word");
            return Err(fault.help(format!("this looks like {looks}")));
        }
        loop {
            let (at, word) = self.word(true);
            if word.eq_ignore_ascii_case(b"ROOT") {
                self.enter(NodeKind::Root, at)?;
                while !self.open.is_empty() {
                    self.body()?;
                }
            } else if word.eq_ignore_ascii_case(b"MOTION") && !self.nodes.is_empty() {
                return Ok(());
            } else {
                let expected = if self.nodes.is_empty() { "ROOT" } else { "ROOT or MOTION" };
                return Err(self.unexpected(at, expected));
            }
        }
    }

    /// Parses a node from after its keyword to its `{`.
    fn enter(&mut self, kind: NodeKind, keyword: usize) -> Step {
        self.blanks();
        let from = self.at;
        // names may have blanks (3ds Max: `Bip01 L Thigh`), so they end at the line or the brace
        while !matches!(self.byte(), None | Some(b'{' | b'\r' | b'\n')) {
            self.at += 1;
        }
        let name = self.text.decode(&self.text.bytes[from..self.at]).trim_matches([' ', '\t']).to_owned();
        if name.is_empty() && kind != NodeKind::End {
            return Err(self.unexpected(from, "the name of a joint"));
        }
        let parent = self.open.last().map(|o| o.node);
        let node = self.nodes.len();
        let unique = if kind == NodeKind::End { String::new() } else { self.unique(&name) };
        self.nodes.push(Node {
            kind,
            name,
            unique,
            parent,
            offset: [0.0; 3],
            channels: Vec::new(),
            column: self.width,
            at: keyword,
        });
        if kind != NodeKind::End {
            self.joints += 1;
        }
        let (brace, word) = self.word(true);
        if word != b"{" {
            return Err(self.unexpected(brace, format!("{:?} for {}", '{', self.label(node))));
        }
        if self.open.len() == MAX_DEPTH {
            let found = format!("{} braces within each other", MAX_DEPTH + 1);
            let fault = self.text.fault(brace, FaultKind::TooDeep, found, format!("at most {MAX_DEPTH}"));
            return Err(fault.help("no body needs that; the file is damaged or no motion"));
        }
        if self.joints > MAX_JOINTS {
            let found = format!("{} joints", self.joints);
            let fault = self.text.fault(keyword, FaultKind::TooLarge, found, format!("at most {MAX_JOINTS}"));
            return Err(fault.help("take the parts of the scene that are no body out of the file"));
        }
        self.open.push(Open { node, brace, offset: false, channels: false, child: false });
        Ok(())
    }

    fn unique(&mut self, name: &str) -> String {
        if !self.seen.contains_key(name) {
            self.seen.insert(name.to_owned(), 1);
            return name.to_owned();
        }
        // the last number is stored, so that thousands of equal names need no search
        loop {
            let last = self.seen.entry(name.to_owned()).or_insert(1);
            *last += 1;
            let unique = format!("{name}.{last}");
            if !self.seen.contains_key(&unique) {
                self.oddities.twice.push(format!("{name:?} (now {unique:?})"));
                self.seen.insert(unique.clone(), 1);
                return unique;
            }
        }
    }

    /// Parses one part of the innermost open node.
    fn body(&mut self) -> Step {
        let (at, word) = self.word(true);
        let Some(top) = self.open.last() else { return Ok(()) };
        let (node, had) = (top.node, (top.offset, top.channels, top.child));
        let end = self.nodes[node].kind == NodeKind::End;
        let is = |w: &str| word.eq_ignore_ascii_case(w.as_bytes());
        if is("OFFSET") && !had.0 && !had.2 {
            self.offset(node)?;
            self.top(|o| o.offset = true);
        } else if is("CHANNELS") && !end && !had.1 && !had.2 {
            self.channels(node)?;
            self.top(|o| o.channels = true);
        } else if (is("JOINT") || is("End")) && !end {
            self.needs_offset(at)?;
            self.top(|o| o.child = true);
            if is("End") {
                self.site();
            }
            self.enter(if is("End") { NodeKind::End } else { NodeKind::Joint }, at)?;
        } else if word == b"}" {
            self.needs_offset(at)?;
            self.leave();
        } else {
            return Err(self.not_in_body(at, word));
        }
        Ok(())
    }

    fn top(&mut self, change: impl FnOnce(&mut Open)) {
        if let Some(top) = self.open.last_mut() {
            change(top);
        }
    }

    /// Skips the second word of `End Site`.
    fn site(&mut self) {
        self.blanks();
        let word = word_at(self.text.bytes, self.at);
        if word.eq_ignore_ascii_case(b"Site") {
            self.at += word.len();
        }
    }

    fn needs_offset(&self, at: usize) -> Step {
        match self.open.last() {
            Some(top) if !top.offset => {
                let fault =
                    self.text.fault(at, FaultKind::OffsetMissing, self.text.found(at), "OFFSET x y z before it");
                Err(fault.help(format!("{} has no OFFSET", self.label(top.node))))
            }
            _ => Ok(()),
        }
    }

    fn leave(&mut self) {
        let Some(top) = self.open.pop() else { return };
        let name = format!("{:?}", self.nodes[top.node].unique);
        if self.nodes[top.node].kind == NodeKind::End {
            return;
        }
        if !top.channels {
            self.oddities.channelless.push(name.clone());
        }
        if !top.child {
            self.oddities.tipless.push(name);
        }
    }

    fn not_in_body(&self, at: usize, word: &[u8]) -> FileError {
        let Some(top) = self.open.last() else { return self.unexpected(at, "ROOT or MOTION") };
        let brace = self.text.place(top.brace);
        let label = self.label(top.node);
        if word.is_empty() || word.eq_ignore_ascii_case(b"MOTION") || word.eq_ignore_ascii_case(b"ROOT") {
            let expected = format!("'}}' for the '{{' of {label} at {}:{}", brace.line, brace.column);
            return self.unexpected(at, expected);
        }
        if Channel::parse(word).is_some() {
            let fault = self.unexpected(at, format!("no more channels in {label}"));
            return fault.help("there are more channel names than CHANNELS says");
        }
        let expected = match (self.nodes[top.node].kind, top.child) {
            (NodeKind::End, _) => "one OFFSET, then '}'",
            (_, false) => "OFFSET and CHANNELS once each, then JOINT, End Site or '}'",
            (_, true) => "JOINT, End Site or '}'",
        };
        self.unexpected(at, format!("in {label} {expected}"))
    }

    fn offset(&mut self, node: usize) -> Step {
        for i in 0..3 {
            let (at, word) = self.word(true);
            let value = number(word).map_err(|bad| {
                let label = self.label(node);
                let keyword = [&b"CHANNELS"[..], b"JOINT", b"END", b"OFFSET", b"ROOT", b"MOTION", b"{", b"}", b""];
                if keyword.iter().any(|k| word.eq_ignore_ascii_case(k)) {
                    let fault =
                        self.text.fault(at, FaultKind::OffsetShort, self.text.found(at), "three numbers after OFFSET");
                    return fault.help(format!("{label} has {i}"));
                }
                let axis = ["x", "y", "z"][i];
                let expected = format!("a finite number for {axis} of the OFFSET of {label}");
                self.text.fault(at, FaultKind::NumberBad, self.text.quote(word), expected).help(match bad {
                    BadNumber::NotFinite => "give the bone its length",
                    other => other.help(),
                })
            })?;
            self.nodes[node].offset[i] = value;
        }
        Ok(())
    }

    fn channels(&mut self, node: usize) -> Step {
        let (at, word) = self.word(true);
        // six channels exist, so a larger count is a damaged file, not a reason to reserve memory
        let count = std::str::from_utf8(word).ok().and_then(|w| w.parse::<usize>().ok()).filter(|&n| n <= 6);
        let Some(count) = count else {
            let label = self.label(node);
            let expected = format!("the number of channels of {label}, 0 to 6");
            let fault = self.text.fault(at, FaultKind::ChannelCount, self.text.found(at), expected);
            return Err(fault.help("count the channel names that follow"));
        };
        for i in 0..count {
            let before = self.at;
            let (at, word) = self.word(true);
            let channel = Channel::parse(word).ok_or_else(|| {
                let label = self.label(node);
                let keyword = [&b"OFFSET"[..], b"JOINT", b"END", b"CHANNELS", b"ROOT", b"MOTION", b"{", b"}", b""];
                let new_line = self.text.bytes[before..at].iter().any(|b| matches!(b, b'\r' | b'\n'));
                if new_line || keyword.iter().any(|k| word.eq_ignore_ascii_case(k)) {
                    let expected = format!("{count} channel names for {label}");
                    let fault = self.text.fault(at, FaultKind::ChannelCount, format!("{i} names"), expected);
                    return fault.help("make the count after CHANNELS and the names agree");
                }
                let expected = "one of Xposition Yposition Zposition Xrotation Yrotation Zrotation";
                let expected = format!("{expected} for {label}");
                let fault = self.text.fault(at, FaultKind::ChannelUnknown, self.text.quote(word), expected);
                fault.help("a BVH has no other channels; rename it, or export the file without it")
            })?;
            if self.nodes[node].channels.contains(&channel) {
                let expected = format!("each channel of {} once", self.label(node));
                let fault = self.text.fault(at, FaultKind::ChannelRepeated, self.text.quote(word), expected);
                return Err(fault.help("rename one of the two"));
            }
            self.nodes[node].channels.push(channel);
        }
        self.nodes[node].column = self.width;
        self.width += count;
        Ok(())
    }
}
