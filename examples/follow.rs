//! A dance that follows some joints of a clip, on the clip's own rig:
//! `cargo run --release --example follow -- demo/run demo/motion/sway/sway_ash_06.bvh follows.bvh`

use kinelm::generate::{OpenRequest, PromptRequest, Request, Rig};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [run, clip, out] = &args[..] else { return Err("the call is: follow RUN CLIP OUT".into()) };
    let prompt = PromptRequest { joints: Some("root,torso,right_arm".into()), ..PromptRequest::of(clip) };
    let request = Request { prompt: Some(prompt), rig: Some(Rig::Prompt), ..Request::of(run) };
    let open = OpenRequest::open(&request)?;
    open.notes()?.iter().for_each(|note| eprintln!("{note}"));
    open.write(out)?;
    println!("{out}: {} frames", open.frames);
    Ok(())
}
