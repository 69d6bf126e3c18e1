//! Changes of a JSON text that leave every other byte as it is.

use serde::Deserialize;
use serde_json::value::RawValue;
use std::ops::Range;

/// The members of a glTF document that an animation adds to.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Members<'a> {
    #[serde(borrow, default)]
    pub animations: Option<&'a RawValue>,
    #[serde(borrow, default)]
    pub accessors: Option<&'a RawValue>,
    #[serde(borrow, default)]
    pub buffer_views: Option<&'a RawValue>,
    #[serde(borrow, default)]
    pub buffers: Option<&'a RawValue>,
    #[serde(borrow, default)]
    pub nodes: Option<&'a RawValue>,
}

/// The values of a list.
pub fn items(list: Option<&RawValue>) -> serde_json::Result<Vec<&RawValue>> {
    list.map_or(Ok(Vec::new()), |list| serde_json::from_str(list.get()))
}

/// A text and what is replaced in it.
pub struct Edits<'a> {
    text: &'a str,
    edits: Vec<(Range<usize>, String)>,
}

impl<'a> Edits<'a> {
    pub fn of(text: &'a str) -> Edits<'a> {
        Edits { text, edits: Vec::new() }
    }

    /// Where a part of the text is: its values borrow from it.
    fn span(&self, part: &str) -> Range<usize> {
        let at = part.as_ptr().addr() - self.text.as_ptr().addr();
        at..at + part.len()
    }

    /// Replaces a value.
    pub fn replace(&mut self, value: &RawValue, by: String) {
        self.edits.push((self.span(value.get()), by));
    }

    /// Replaces a member, key and value, by others. `false` where its key is written with escapes.
    pub fn replace_member(&mut self, key: &str, value: &RawValue, by: String) -> bool {
        let value = self.span(value.get());
        let before = self.text[..value.start].trim_end().strip_suffix(':').map(str::trim_end);
        let before = before.and_then(|before| before.strip_suffix(&format!("\"{key}\"")));
        before.is_some_and(|before| {
            self.edits.push((before.len()..value.end, by));
            true
        })
    }

    /// Adds items to the list of a member of the document, which is added where it is missing.
    pub fn append(&mut self, member: &str, list: Option<&RawValue>, items: &[String]) {
        if items.is_empty() {
            return;
        }
        let (items, end) = (items.join(","), self.text.trim_end().len() - 1);
        let (at, added) = match list {
            Some(list) => {
                let is_empty = list.get()[1..list.get().len() - 1].trim().is_empty();
                (self.span(list.get()).end - 1, if is_empty { items } else { format!(",{items}") })
            }
            // a document has an `asset`, so there is a member before it
            None => (end, format!(",\"{member}\":[{items}]")),
        };
        self.edits.push((at..at, added));
    }

    /// The text with its changes.
    pub fn text(mut self) -> String {
        // stable: what is added at one place stays in its order
        self.edits.sort_by_key(|(span, _)| span.start);
        let (mut out, mut at) = (String::with_capacity(self.text.len()), 0);
        for (span, by) in &self.edits {
            out.push_str(&self.text[at..span.start]);
            out.push_str(by);
            at = span.end;
        }
        out.push_str(&self.text[at..]);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_named_changes() {
        let text = "{ \"z\": 1e1, \"nodes\":[ {\"matrix\" : [1, 2],\"n\":1.50}, {} ],\n\"accessors\": [ ], \"a\": \"\\u00e9\" }\n";
        let members: Members = serde_json::from_str(text).unwrap();
        #[derive(Deserialize)]
        struct Node<'a> {
            #[serde(borrow)]
            matrix: &'a RawValue,
        }
        let nodes = items(members.nodes).unwrap();
        let node: Node = serde_json::from_str(nodes[0].get()).unwrap();
        let mut edits = Edits::of(text);
        edits.append("animations", members.animations, &["7".into()]);
        edits.append("accessors", members.accessors, &["1".into(), "2".into()]);
        edits.append("nodes", members.nodes, &["3".into()]);
        edits.replace(nodes[1], "{\"x\":0}".into());
        assert!(edits.replace_member("matrix", node.matrix, "\"t\":[3]".into()));
        assert_eq!(
            edits.text(),
            "{ \"z\": 1e1, \"nodes\":[ {\"t\":[3],\"n\":1.50}, {\"x\":0} ,3],\n\"accessors\": [ 1,2], \"a\": \"\\u00e9\" \
             ,\"animations\":[7]}\n"
        );
    }
}
