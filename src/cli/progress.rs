//! Progress bars, only where somebody watches.

use super::Say;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use kinelm::corpus::build::{Event, Watch};
use std::ops::ControlFlow;

/// A bar of `total` steps on stderr; hidden when stderr is no terminal or `--quiet` was given.
pub fn bar(total: u64, what: &str, say: Say) -> ProgressBar {
    let target = if say.quiet() { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(total), target);
    let template = format!("{{bar:30}} {{pos}}/{{len}} {what}, {{eta}} left {{msg}}");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    bar
}

/// A bar over files; bad ones are named as they turn up.
pub fn watch(say: Say) -> Box<Watch<'static>> {
    let mut shown: Option<ProgressBar> = None;
    Box::new(move |event| {
        match event {
            Event::Done { done, of, .. } => {
                let bar = shown.get_or_insert_with(|| bar(of as u64, "files", say));
                bar.set_position(done as u64);
                if done == of {
                    bar.finish_and_clear();
                }
            }
            Event::Failed { item, error } => {
                let text = format!("{}: left out: {error}", item.name);
                match &shown {
                    Some(bar) => bar.suspend(|| say.error(text)),
                    None => say.error(text),
                }
            }
        }
        ControlFlow::Continue(())
    })
}
