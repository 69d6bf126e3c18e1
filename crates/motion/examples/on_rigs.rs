//! Puts a dance on the rigs of many tools, for trials: `cargo run --release -p kinelm-motion --example on_rigs --
//! dance.bvh OUT [FPS]`, FPS if the file's own is wrong.
//!
//! Writes OUT/RIG.bvh: the tool's hierarchy and names (`tests/rigs`), bones up to 10 % longer or shorter than SMPL's. Rest
//! poses in turn: a T-pose; the dance's first pose; a T-pose whose joints' axes are turned at random.

#[allow(dead_code)]
#[path = "../tests/rigs/mod.rs"]
mod rigs;

use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::{Motion, retarget};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [dance, out, fps @ ..] = &args[..] else { return Err("expected DANCE OUT [FPS]".into()) };
    let fps_source = fps.first().map(|fps| fps.parse()).transpose()?;
    let motion = format::read(Path::new(dance), &ReadOptions { fps_source, ..Default::default() })?;
    let dance = retarget::to_smpl(&motion)?;
    for (i, tree) in rigs::all().into_iter().enumerate() {
        let mut random = rigs::random(1 + i as u64);
        let body = rigs::varied(0.1, &mut random);
        let rig = tree.skeleton(&body);
        let on_rig = tree.dance(&rig, &dance.clone().with_skeleton(body.into())?);
        let clip = match i % 3 {
            0 => on_rig,
            1 => rigs::from_pose(&on_rig, 0),
            _ => rigs::tilted(&on_rig, &rigs::turns(rig.joints(), &mut random)),
        };
        let path = Path::new(out).join(format!("{}.bvh", tree.rig));
        format::write(&path, &Motion::new(&path, clip))?;
        println!("{}", path.display());
    }
    Ok(())
}
