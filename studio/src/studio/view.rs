//! The project as pages get it.

use super::Studio;
use crate::error::without_folders;
use crate::library::search;
use crate::project::document::{ClipRecord, DanceRecord, Document};
use serde_json::{Value, json};

/// Keys whose texts name no folders.
const TEXTS: [&str; 5] = ["text", "error", "note", "notes", "what"];

impl Studio {
    /// A text without the folders of paths.
    pub fn plain(&self, text: &str) -> String {
        without_folders(text, &self.roots)
    }

    /// Texts of an answer without folders.
    pub(super) fn cleaned(&self, mut value: Value) -> Value {
        self.clean(&mut value, false);
        value
    }

    pub(super) fn clean(&self, value: &mut Value, is_text: bool) {
        match value {
            Value::String(text) if is_text => *text = self.plain(text),
            Value::Array(all) => all.iter_mut().for_each(|value| self.clean(value, is_text)),
            Value::Object(all) => {
                all.iter_mut().for_each(|(key, value)| self.clean(value, TEXTS.contains(&&**key)));
            }
            _ => {}
        }
    }

    /// All that a page begins with.
    pub fn state(&self) -> Value {
        let (clips, dances, music) = self.project.read(|document| {
            let Document { clips, dances, music, .. } = document.clone();
            (clips, dances, music)
        });
        let clips: Vec<Value> = clips.iter().map(|clip| self.clip_view(clip)).collect();
        let dances: Vec<Value> = dances.iter().map(|dance| self.dance_view(dance)).collect();
        let jobs: Vec<Value> = self.jobs.views().into_iter().map(|job| self.cleaned(job)).collect();
        let model = self.maker.model.view();
        let name = self.project.folder().file_name().unwrap_or_default().to_string_lossy().into_owned();
        json!({
            "version": env!("CARGO_PKG_VERSION"), "project": name, "groups": model["groups"], "model": model,
            "clips": clips, "dances": dances, "jobs": jobs, "music": music, "undo": self.undo_view(),
            "maps": self.maps(), "search_s": search::window_s(), "last_event": self.hub.last(),
        })
    }

    pub(super) fn undo_view(&self) -> Value {
        let ((undo, redo), (undo_name, redo_name)) = self.project.history();
        json!({ "undo": undo, "redo": redo, "undo_name": undo_name, "redo_name": redo_name })
    }

    pub(super) fn clip_view(&self, clip: &ClipRecord) -> Value {
        self.cleaned(self.library.view(clip))
    }

    pub(super) fn dance_view(&self, dance: &DanceRecord) -> Value {
        let kept =
            dance.kept.as_ref().and_then(|file| file.file_name()).map(|name| name.to_string_lossy().into_owned());
        let mut view = json!({
            "id": dance.id, "name": dance.name, "kept": dance.kept.is_some(), "rejected": dance.rejected,
            "seconds": dance.frames as f64 / dance.fps, "frames": dance.frames, "fps": dance.fps, "job": dance.job,
            "variation": dance.variation, "seed": dance.seed, "note": dance.note, "generated_s": dance.generated_s,
            "given": dance.given, "free": dance.free, "source": dance.source, "rig": dance.rig,
            "opening": dance.opening,
            "made": dance.made_spans, "kept_name": kept,
        });
        if let Some(best) = &dance.best {
            view["score"] = json!(best.verdict.score);
            view["verdict"] = json!(best.verdict.to_string());
            view["rank"] = json!([best.better + 1, best.of]);
        }
        self.cleaned(view)
    }
}
