use super::*;
use crate::rotation::angle_between;

const SECONDS: f64 = 14.0;
const FPS: f64 = 60.0;

fn twelve() -> Vec<Dance> {
    corpus(1, 12, SECONDS, FPS).unwrap()
}

fn score_of(index: usize) -> Score {
    let (g, d) = (index % 4, index / 4 % 3);
    Score::new(&GENRES[g], &DANCERS[d], None, SECONDS, &mut Rng::new(1, &[g as u64, d as u64, 0]))
}

#[test]
fn the_same_seed_gives_the_same_dances() {
    let (a, b) = (twelve(), corpus(1, 13, SECONDS, FPS).unwrap());
    assert_eq!(a[..], b[..12]);
    assert_eq!(a[0].name(), "sway_ash_01");
    assert_eq!((b[12].genre, b[12].dancer, b[12].take), ("sway", "ash", 2));
    assert_ne!(b[12].clip, b[0].clip);
    assert_ne!(corpus(2, 1, SECONDS, FPS).unwrap()[0].clip, a[0].clip);
    assert_eq!(a[0].clip.frames(), 840);
}

#[test]
fn feet_stand_on_the_floor_and_stay_there() {
    for (i, d) in twelve().iter().enumerate() {
        let (p, steps) = (d.clip.positions(), score_of(i).steps());
        let (mut slid, mut stood) = ([0.0f64; 2], 0);
        for f in 1..d.clip.frames() {
            for foot in 0..2 {
                let (now, before) = (p[24 * f + 10 + foot], p[24 * (f - 1) + 10 + foot]);
                assert!((-1e-6..0.4).contains(&now.y), "{} frame {f}: toe at {}", d.name(), now.y);
                assert!(p[24 * f + 7 + foot].y > 0.04, "{} frame {f}: an ankle in the floor", d.name());
                if steps.stands(foot, f as f64 / FPS) && steps.stands(foot, (f - 1) as f64 / FPS) {
                    assert!(now.y < 1e-3, "{} frame {f}: a standing toe at {}", d.name(), now.y);
                    slid[foot] += (now - before).length();
                    stood += 1;
                }
            }
        }
        assert!(stood > d.clip.frames(), "{}: a foot stands half the time", d.name());
        assert!(slid[0].max(slid[1]) < 0.01, "{}: standing toes slid {slid:?} m", d.name());
    }
}

#[test]
fn nothing_jumps_and_knees_bend_forward() {
    for d in twelve() {
        let c = &d.clip;
        for f in 1..c.frames() {
            assert!((c.root()[f] - c.root()[f - 1]).length() * FPS < 2.0, "{} frame {f}", d.name());
            for j in 0..24 {
                let speed = angle_between(c.pose(f)[j], c.pose(f - 1)[j]) * FPS;
                assert!(speed < 16.0, "{} frame {f}: {} turns at {speed} rad/s", d.name(), smpl::NAMES[j]);
            }
            for knee in [4, 5] {
                let q = c.pose(f)[knee];
                assert!(2.0 * q.x.atan2(q.w) > -0.1, "{} frame {f}: knee {}", d.name(), 2.0 * q.x.atan2(q.w));
            }
        }
    }
}

#[test]
fn a_dance_ends_in_a_stand() {
    for d in twelve() {
        let (p, n) = (d.clip.positions(), d.clip.frames());
        let moved = (0..24).map(|j| (p[24 * (n - 1) + j] - p[24 * (n - 13) + j]).length()).fold(0.0, f64::max);
        assert!(moved < 0.03, "{}: {moved} m in the last fifth of a second", d.name());
    }
}

/// Mean speed of a joint relative to the pelvis, m/s.
fn speed(clip: &Clip, joint: usize) -> f64 {
    let p = clip.positions();
    let seen = |f: usize| p[24 * f + joint] - p[24 * f];
    (1..clip.frames()).map(|f| (seen(f) - seen(f - 1)).length()).sum::<f64>() * clip.fps() / clip.frames() as f64
}

#[test]
fn genres_and_dancers_differ() {
    let all = twelve();
    let of = |genre: &str, joint: usize| {
        all.iter().filter(|d| d.genre == genre).map(|d| speed(&d.clip, joint)).sum::<f64>() / 3.0
    };
    assert!(of("stomp", 7) > 2.0 * of("wave", 7), "stomps lift their feet: {} {}", of("stomp", 7), of("wave", 7));
    for d in &all {
        assert_eq!(turned(&d.clip) > 3.0, d.genre == "spin", "{} turned {} rad", d.name(), turned(&d.clip));
    }
    let hands = |dancer: &str| {
        all.iter().filter(|d| d.dancer == dancer).map(|d| speed(&d.clip, 20) + speed(&d.clip, 21)).sum::<f64>()
    };
    assert!(hands("ash") > 1.1 * hands("birch"), "{} {}", hands("ash"), hands("birch"));
}

/// The largest heading away from the front, radians, including whole turns.
fn turned(clip: &Clip) -> f64 {
    let mut facing = 0.0;
    let mut far = 0.0f64;
    for f in 0..clip.frames() {
        let now = crate::rotation::heading(clip.pose(f)[0]).unwrap();
        facing = crate::rotation::euler::unwrap_near(now, facing);
        far = far.max(facing.abs());
    }
    far
}

#[test]
fn any_length_and_rate() {
    for seconds in [0.0, 0.01, 1.0, 3.0, 7.3] {
        for fps in [1.0, 20.0, 29.97, 240.0] {
            for d in corpus(9, 12, seconds, fps).unwrap() {
                assert_eq!(d.clip.frames(), (seconds * fps).round() as usize);
            }
        }
    }
    for (seconds, fps) in
        [(-1.0, 60.0), (f64::NAN, 60.0), (1e9, 60.0), (1.0, 0.0), (1.0, f64::NAN), (1.0, f64::INFINITY)]
    {
        assert!(corpus(1, 1, seconds, fps).is_err());
    }
}

#[test]
fn at_another_rate_it_is_the_same_dance() {
    let (a, b) = (corpus(3, 4, 8.0, 120.0).unwrap(), corpus(3, 4, 8.0, 60.0).unwrap());
    for (a, b) in a.iter().zip(&b) {
        let (p, q) = (a.clip.positions(), b.clip.positions());
        for f in 0..b.clip.frames() {
            for j in 0..24 {
                let distance = (p[24 * 2 * f + j] - q[24 * f + j]).length();
                assert!(distance < 0.02, "{} frame {f} {}: {distance} m", a.name(), smpl::NAMES[j]);
            }
        }
    }
}

#[test]
fn beats_are_those_of_the_score() {
    for (i, d) in twelve().iter().enumerate() {
        let score = score_of(i);
        let step = d.beats_s[1] - d.beats_s[0];
        assert!(d.beats_s.windows(2).all(|w| (w[1] - w[0] - step).abs() < 1e-9), "{}", d.name());
        assert!(d.beats_s[0] >= 0.0 && d.beats_s[0] < step && d.beats_s[d.beats_s.len() - 1] > SECONDS - step);
        // standing lasts 0.6 s
        assert!((d.beats_s[d.downbeat] - 0.6).abs() < 1e-9, "{}: {:?}", d.name(), d.beats_s);
        assert_eq!((d.beats_s.clone(), d.downbeat), score.beats(SECONDS));
    }
    assert!(corpus(1, 1, 0.0, FPS).unwrap()[0].beats_s.is_empty());
}
