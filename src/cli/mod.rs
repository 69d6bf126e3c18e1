//! The command line: one file a command. Arguments in, one library call, text out.
//!
//! Only here and beside it (`shell`, `demo`) are there `anyhow`, printing and environment variables. Data go to stdout, everything else to stderr.

mod aclstm;
mod again;
mod classify;
mod clean;
mod command;
mod compare;
mod completions;
mod config;
mod convert;
mod corpus;
mod data;
mod draw;
mod evaluate;
mod export;
mod filter;
mod finetune;
mod fit;
mod generate;
mod import;
mod inspect;
mod interpolate;
mod lr_find;
mod many;
mod mirror;
mod music;
mod music_lstm;
mod named;
mod needs;
mod pretrain;
mod query;
mod read;
mod runs;
mod spectrum;
#[cfg(feature = "studio")]
mod studio;
mod study;
mod tokenize;
mod tokenizer;
mod tune;
mod updates;
mod values;
mod view;

use crate::shell::outcome::{exit_code, is_broken_pipe, parse, refused};
use crate::shell::say::all_read;
use crate::shell::{
    BranchArgs, CheckpointArg, ComputeArgs, ForceArgs, Odd, ReadingArgs, Say, TrustArgs, WrongCall, chain, draw_charts,
    each_file, extension, motion_files, page, picture, print, progress, reported, tell, training, warn,
    with_extensions, writable, writable_into, written_as, wrong_call,
};
use anyhow::{Error, Result};
use command::{Call, command};
use kinelm_engine::arena::NoMemory;
use kinelm_store::input::Inputs;
use std::ffi::OsString;
use std::panic::{AssertUnwindSafe, resume_unwind};

/// Bytes of stack of a thread that computes: what a program's first thread has.
const STACK: usize = 8 << 20;

/// The program's commands and flags, from which its man pages are made.
pub fn parser() -> clap::Command {
    <Call as clap::CommandFactory>::command()
}

/// Runs one call of the program, its name in front, and gives the exit code. 0: done. 1: the work failed. 2: the call was
/// wrong. 130: stopped by Ctrl-C, what is done is saved. A reader that closes the pipe early is no failure.
///
/// It sets up the threads of the whole process: a process calls it once.
pub fn run(args: impl IntoIterator<Item = OsString>) -> u8 {
    let args: Vec<OsString> = args.into_iter().collect();
    let call = match parse::<Call>(&args, needs::check) {
        Ok(call) => call,
        Err(e) => return refused(e),
    };
    match work(call) {
        Ok(()) => 0,
        Err(e) if is_broken_pipe(&e) => 0,
        Err(e) => {
            tell(chain(&e));
            exit_code(&e)
        }
    }
}

fn work(call: Call) -> Result<()> {
    check_kernels()?;
    let mut pool = rayon::ThreadPoolBuilder::new().stack_size(STACK);
    if let Some(n) = call.threads {
        pool = pool.num_threads(n.into());
    }
    pool.build_global()?;
    let say = Say { quiet: call.quiet };
    #[cfg(feature = "studio")]
    if let command::Command::Studio(args) = call.command {
        // the server waits; a thread of the pool would be lost to what computes
        return studio::run(args, say);
    }
    progress::report_waits(say);
    // no command overwrites what it has read; a mere `_` would end the recording at once
    let _inputs = Inputs::record();
    // on a thread of the pool: from outside, every parallel step would wake its threads anew and wait for them asleep
    let whole = || rayon::scope(|_| command(call.command, say).and_then(|()| all_read()));
    // arenas unwind where the system has no memory left: a message then, like that of any other error
    std::panic::catch_unwind(AssertUnwindSafe(whole)).unwrap_or_else(|payload| match payload.downcast::<NoMemory>() {
        Ok(none) => Err(Error::new(*none).context("memory ran out; a smaller model, batch or context takes less")),
        Err(other) => resume_unwind(other),
    })
}

/// Refuses kernels that have no such name.
fn check_kernels() -> Result<()> {
    use kinelm_engine::dispatch::{NAMES, VARIABLE};
    match std::env::var(VARIABLE) {
        Ok(name) if !NAMES.contains(&name.as_str()) => {
            let what = format!("{VARIABLE} is {name:?}; expected one of {}, or nothing", NAMES.join(", "));
            Err(WrongCall(what).into())
        }
        _ => Ok(()),
    }
}
