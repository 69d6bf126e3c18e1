//! Progress: a bar on a terminal, else plain lines at growing intervals.

use super::Say;
pub use super::wait::stage;
use super::wait::{LAST_GAP, Wait, wait};
use crate::corpus::build::{BuildEvent, BuildProgress};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// Starts a thread that reports waits.
pub fn report_waits(say: Say) {
    if say.quiet() {
        return;
    }
    std::thread::spawn(|| {
        loop {
            std::thread::sleep(Duration::from_millis(200));
            // the lock is free again before stderr, which may block
            let line = wait().due(Instant::now());
            if let Some(line) = line {
                // a closed stderr is no reason to stop
                let _ = std::io::stderr().write_all(format!("kinelm: {line}\n").as_bytes());
            }
        }
    });
}

/// Stderr for work that prints its own progress: waits are not reported on a terminal, and elsewhere only after a long
/// silence.
pub struct ProgressStderr(std::io::Stderr);

impl ProgressStderr {
    /// Stderr for the progress of `what`.
    pub fn of(what: &str) -> ProgressStderr {
        stage(what);
        ProgressStderr(std::io::stderr())
    }
}

impl Write for ProgressStderr {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let mut wait = wait();
        // on a terminal its own line is progress enough; elsewhere a line after half a minute of silence
        (wait.shown, wait.said, wait.gap) = (self.0.is_terminal(), Instant::now(), LAST_GAP / 2);
        drop(wait);
        self.0.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

impl Drop for ProgressStderr {
    fn drop(&mut self) {
        stage("at work");
    }
}

/// A count of steps: a bar on a terminal, lines elsewhere.
pub struct Bar(ProgressBar);

/// A count of `total` steps on stderr; hidden with `--quiet`.
pub fn bar(total: u64, what: &str, say: Say) -> Bar {
    let target = if say.quiet() { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(total), target);
    let template = format!("{{bar:30}} {{pos}}/{{len}} {what}, {{eta}} left {{msg}}");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    bar.tick();
    *wait() = Wait { shown: !bar.is_hidden(), ..Wait::new(what, total, Instant::now()) };
    Bar(bar)
}

impl Bar {
    /// Sets the number of steps done.
    pub fn set_position(&self, done: u64) {
        self.0.set_position(done);
        wait().done = done;
    }

    /// Sets the text next to the bar.
    pub fn set_message(&self, message: String) {
        self.0.set_message(message);
    }

    /// Prints something above the bar.
    pub fn suspend(&self, say: impl FnOnce()) {
        self.0.suspend(say);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
        stage("at work");
    }
}

/// A bar over files, followed by the stage `then`; bad files are reported as they turn up.
pub fn watch(say: Say, then: &'static str) -> Box<BuildProgress<'static>> {
    let mut shown: Option<Bar> = None;
    Box::new(move |event| {
        match event {
            BuildEvent::Done { done, of, .. } => {
                shown.get_or_insert_with(|| bar(of as u64, "files", say)).set_position(done as u64);
                // the bar goes when it is full, as the next stage has none
                if done == of {
                    shown = None;
                    stage(then);
                }
            }
            BuildEvent::Failed { item, why } => {
                let text = format!("{}: left out: {why}", item.name);
                match &shown {
                    Some(bar) => bar.suspend(|| say.left_out(text)),
                    None => say.left_out(text),
                }
            }
        }
        ControlFlow::Continue(())
    })
}
