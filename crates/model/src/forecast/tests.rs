use super::*;
use kinelm_store::random;
use rand_chacha::rand_core::RngCore;

const ANGLE: Bins = Bins { first: 6, count: 360, circular: true };
const HEIGHT: Bins = Bins { first: 6, count: 90, circular: false };

fn places() -> Vec<Bins> {
    vec![ANGLE, HEIGHT, ANGLE]
}

/// Coefficients of up to a third of a bin a step.
fn forecast() -> Forecast {
    let mut forecast = Forecast::still(places());
    let mut rng = random::stream(1, "forecast", 0, 0);
    for w in forecast.all.iter_mut().chain(&mut forecast.own) {
        *w = (rng.next_u32() % 40_001) as i32 - 20_000;
    }
    forecast
}

/// Ids of frames that wander by up to 9 bins.
fn wandering(frames: usize, seed: u64) -> Vec<u32> {
    let mut rng = random::stream(seed, "wandering", 0, 0);
    let (mut at, mut ids) = ([350i64, 4, 0], Vec::new());
    for _ in 0..frames {
        for (at, place) in at.iter_mut().zip(places()) {
            let to = *at + i64::from(rng.next_u32() % 19) - 9;
            *at = if place.circular { to.rem_euclid(360) } else { to.clamp(0, 89) };
            ids.push(6 + *at as u32);
        }
        ids.push(5);
    }
    ids
}

/// The forecasts (F, C) of all frames of `ids`, whole words of a slot each and a space; 0 for the first.
fn of_words(forecast: &Forecast, ids: &[u32]) -> Vec<i32> {
    let mut track = Track::new(forecast.slots(), ids.len().div_ceil(forecast.slots() + 1));
    track.follow(forecast, ids);
    track.into_forecasts()
}

/// The definition, in floating point and in no hurry.
fn by_hand(forecast: &Forecast, ids: &[u32], frame: usize, slot: usize) -> f64 {
    let c = 3;
    let bin = |f: usize, s: usize| (ids[4 * f + s] - 6) as i64;
    let step = |f: usize, s: usize| {
        if f == 0 {
            return 0.0;
        }
        let by = bin(f, s) - bin(f - 1, s);
        let by = if places()[s].circular { (by + 180).rem_euclid(360) - 180 } else { by };
        let most = [40, 10, 40][s];
        by.clamp(-most, most) as f64
    };
    let w = |x: i32| f64::from(x) / 65536.0;
    let both = |f: usize| {
        let known = (f - 1).min(LAGS);
        let (mut all, mut own) = (0.0, 0.0);
        for (from, lag) in (0..c).flat_map(|s| (0..known).map(move |lag| (s, lag))) {
            all += step(f - 1 - lag, from) * w(forecast.all[(known * 16 + lag * c + from) * c + slot]);
            own += if from == slot {
                step(f - 1 - lag, slot) * w(forecast.own[(known * 5 + lag) * c + slot])
            } else {
                0.0
            };
        }
        all += w(forecast.all[(known * 16 + 12) * c + slot]);
        own += w(forecast.own[(known * 5 + 4) * c + slot]);
        all += (0..slot).map(|s| step(f, s) * w(forecast.all[(known * 16 + 13 + s) * c + slot])).sum::<f64>();
        let most = [60.0, 15.0, 60.0][slot];
        [all.clamp(-most, most), own.clamp(-most, most)]
    };
    let mut errors = [1.0; 2];
    for f in frame.saturating_sub(ERRORS).max(1)..frame {
        let most = [40.0, 10.0, 40.0][slot];
        errors.iter_mut().zip(both(f)).for_each(|(e, x)| *e += (step(f, slot) - x).abs().min(most));
    }
    let [all, own] = both(frame);
    let [a, o] = errors.map(|e| e.powi(-4));
    (a * all + o * own) / (a + o)
}

#[test]
fn forecasts_are_the_definition() {
    let (forecast, ids) = (forecast(), wandering(40, 2));
    let found = of_words(&forecast, &ids);
    assert_eq!((found.len(), &found[..3]), (120, &[0; 3][..]));
    let mut largest = 0.0f64;
    for (frame, slot) in (1..40).flat_map(|frame| (0..3).map(move |slot| (frame, slot))) {
        let (found, expected) = (f64::from(found[3 * frame + slot]) / 65536.0, by_hand(&forecast, &ids, frame, slot));
        // eight bits of the errors: a weight is right to a few hundredths
        assert!((found - expected).abs() < 0.3, "frame {frame}, slot {slot}: {found}, expected {expected}");
        largest = largest.max(expected.abs());
    }
    assert!(largest > 3.0, "{largest}");
}

#[test]
fn a_forecast_reads_its_history_and_nothing_else() {
    let (forecast, ids) = (forecast(), wandering(60, 3));
    let last = |ids: &[u32]| of_words(&forecast, ids)[3 * 59..].to_vec();
    let at = 4 * (59 - HISTORY);
    assert_eq!(last(&ids), of_words(&forecast, &ids[at..])[3 * HISTORY..]);
    let other = |frame: usize| [&ids[..4 * frame], &wandering(1, 9), &ids[4 * frame + 4..]].concat();
    assert_eq!(last(&other(59 - HISTORY - 1)), last(&ids));
    assert_ne!(last(&other(59 - HISTORY)), last(&ids));
    // its own slot and those after it aren't read either
    let mut changed = ids.clone();
    changed[4 * 59 + 1] = 6;
    assert_eq!(last(&changed)[..2], last(&ids)[..2]);
    assert_ne!(last(&changed)[2], last(&ids)[2]);
}

#[test]
fn a_track_that_goes_back_is_as_one_that_never_went() {
    let (forecast, ids, wrong) = (forecast(), wandering(30, 4), wandering(30, 5));
    let all = of_words(&forecast, &ids);
    let bin = |ids: &[u32], slot: usize| places()[slot % 3].bin(ids[slot / 3 * 4 + slot % 3]);
    let mut track = Track::new(3, 30);
    for (slot, &expected) in all.iter().enumerate() {
        // up to two frames of another dance go in and are taken back
        for ahead in slot..(slot + slot % 7).min(90) {
            track.push(&forecast, bin(&wrong, ahead));
        }
        track.truncate(slot);
        assert_eq!(track.next(&forecast), expected, "{slot}");
        track.push(&forecast, bin(&ids, slot));
    }
    assert_eq!(track.forecasts(), all);
}

#[test]
fn a_straight_line_is_found() {
    // the second slot moves as the first one did a frame before, the third as the first does now and by one bin
    let mut rng = random::stream(6, "line", 0, 0);
    let mut steps = vec![0i64];
    steps.extend((0..4000).map(|_| i64::from(rng.next_u32() % 9) - 4));
    let (mut at, mut bins) = ([0i64, 45, 0], Vec::new());
    for now in steps.windows(2) {
        at = [at[0] + now[1], 45 + now[0], at[2] + now[1] + 1];
        bins.extend([at[0].rem_euclid(360), at[1], at[2].rem_euclid(360)].map(|bin| Some(bin as usize)));
    }
    let mut fit = Fit::new(places());
    fit.add(&bins, 1.0);
    let forecast = fit.forecast();
    let ids: Vec<u32> =
        bins[..300].chunks(3).flat_map(|f| f.iter().map(|b| 6 + b.unwrap() as u32).chain([5])).collect();
    let found = of_words(&forecast, &ids);
    for (frame, found) in found.chunks(3).enumerate().skip(40) {
        let step = |frame: usize| steps[frame + 1] as f64;
        // the second's step: from the first's step two frames ago to that of the last
        let expected = [f64::NAN, step(frame - 1) - step(frame - 2), step(frame) + 1.0];
        for slot in [1, 2] {
            let found = f64::from(found[slot]) / 65536.0;
            assert!((found - expected[slot]).abs() < 0.1, "frame {frame}, slot {slot}: {found}, {}", expected[slot]);
        }
    }
    let [all, own] = &forecast.tensors();
    assert_eq!(Forecast::of_tensors(places(), [all, own]).unwrap(), forecast);
}

#[test]
fn what_is_no_forecast_is_named() {
    let [all, mut own] = Forecast::still(places()).tensors();
    own[7] = 0.5;
    let message = Forecast::of_tensors(places(), [&all, &own]).unwrap_err().to_string();
    assert_eq!(message, "forecast.own holds 0.5; expected whole numbers up to 16777216");
}

#[test]
fn numbers_lie_between_knots_and_whole_bins_are_the_nearest() {
    let of = |forecast: i32, last: i32| {
        let mut out = [f32::NAN; NUMBERS];
        numbers(forecast, last, &mut out);
        out
    };
    let set = |forecast, last| -> Vec<(usize, f32)> {
        of(forecast, last).into_iter().enumerate().filter(|(_, x)| *x != 0.0).collect()
    };
    // 0, -1, 1 and no fraction
    assert_eq!(set(0, 1), [(9, 1.0), (19 + 6, 1.0), (38 + 12, 1.0), (57 + 2, 1.0)]);
    // 3.25 between 2 and 4, 0.25; 3; a quarter
    let three = [(13, 0.375), (14, 0.625), (19 + 10, 1.0), (38 + 13, 0.5), (38 + 14, 0.5), (57 + 3, 1.0)];
    assert_eq!(set(3 * BIN + BIN / 4, 3), three);
    assert_eq!(set(-200 * BIN, 0)[..2], [(0, 1.0), (19, 1.0)]);
    for x in (-70 * BIN..70 * BIN).step_by(1234) {
        let all = of(x, 2);
        let sums = [0..19, 19..38, 38..57, 57..62].map(|part| all[part].iter().sum::<f32>());
        assert_eq!(sums, [1.0; 4], "{x}");
    }
    assert_eq!((whole(BIN / 2 - 1), whole(BIN / 2), whole(-BIN / 2), whole(-BIN / 2 - 1)), (0, 1, 0, -1));
    assert_eq!([reached(HEIGHT, 80, 20 * BIN), reached(HEIGHT, 3, -4 * BIN)], [89, 0]);
    assert_eq!([reached(ANGLE, 350, 20 * BIN), reached(ANGLE, 3, -4 * BIN)], [10, 359]);
}
