//! Laban's proxies over recorded salsas: what the rate changes, and which say the same (docs/measures.md, "Laban").

use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::metric::Laban;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::Retarget;
use kinelm_motion::{Clip, smpl};

const NAMES: [&str; 7] = ["weight", "time", "flow", "space", "angular", "volume", "box"];

fn salsas() -> Vec<Clip> {
    let Some(folder) = kinelm_shared_data::set("cmu-dance", "laban_shared") else { return Vec::new() };
    let files = std::fs::read_dir(folder.join("salsa")).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = files.filter(|path| path.extension().is_some_and(|e| e == "bvh")).collect();
    files.sort();
    let read = |path: &std::path::PathBuf| {
        // CMU dances settle in their first ten frames; their files state twice their rate
        let motion =
            format::read(path, &ReadOptions { skip: 10, fps_source: Some(60.0), ..Default::default() }).unwrap();
        Retarget::new(motion.humanoid().unwrap(), smpl::neutral()).unwrap().to_smpl(&motion.clip).unwrap()
    };
    files.iter().map(read).collect()
}

fn row(clip: &Clip) -> [f64; 7] {
    let Laban { weight, time, flow, space, volume, box_volume, angular } = Laban::of(clip).unwrap().unwrap();
    [weight, time, flow, space.unwrap(), angular, volume, box_volume]
}

fn correlation(rows: &[[f64; 7]], a: usize, b: usize) -> f64 {
    let n = rows.len() as f64;
    let mean = |i: usize| rows.iter().map(|row| row[i]).sum::<f64>() / n;
    let product = |i: usize, k: usize| rows.iter().map(|row| (row[i] - mean(i)) * (row[k] - mean(k))).sum::<f64>();
    product(a, b) / (product(a, a) * product(b, b)).sqrt()
}

#[test]
fn the_rate_changes_little_and_time_follows_flow() {
    let clips = salsas();
    if clips.is_empty() {
        return;
    }
    let rows: Vec<_> = clips.iter().map(row).collect();
    for (a, name) in NAMES.iter().enumerate() {
        let mean = rows.iter().map(|row| row[a]).sum::<f64>() / rows.len() as f64;
        let with: Vec<String> = (0..NAMES.len()).map(|b| format!("{:5.2}", correlation(&rows, a, b))).collect();
        println!("{name:8} {mean:8.3}  {}", with.join(" "));
    }
    for fps in [20.0, 30.0, 60.0] {
        let others: Vec<_> = clips.iter().map(|clip| row(&resample(clip, fps, Method::Auto).unwrap())).collect();
        for (i, name) in NAMES.iter().enumerate() {
            let mut ratios: Vec<f64> = others.iter().zip(&rows).map(|(other, own)| other[i] / own[i]).collect();
            ratios.sort_by(f64::total_cmp);
            let median = ratios[ratios.len() / 2];
            println!("{fps} fps, {name}: {:.3} {median:.3} {:.3}", ratios[0], ratios[ratios.len() - 1]);
            assert!((median - 1.0).abs() < 0.03, "{fps} fps, {name}: {median} of the figure at the file's rate");
        }
    }
    assert!(correlation(&rows, 1, 2) > 0.9 && correlation(&rows, 3, 0) < 0.5);
}
