//! Blends of real salsas, in which dancers turn all the time.

use kinelm_motion::Motion;
use kinelm_motion::format::{ReadOptions, read};
use kinelm_spectral::interpolate::{
    Alignment, Coordinates, InterpolateOptions, JITTER_BOUND, Method, Spectrum, interpolate,
};

/// The salsas that are held out.
const SALSAS: [&str; 6] = ["03", "07", "11", "18", "22", "26"];

fn salsas(test: &str) -> Option<Vec<Motion>> {
    let folder = kinelm_shared_data::set("cmu-dance", test)?;
    let options = ReadOptions { fps_source: Some(60.0), skip: 10, ..ReadOptions::default() };
    Some(SALSAS.iter().map(|name| read(&folder.join(format!("salsa/{name}.bvh")), &options).unwrap()).collect())
}

/// The jitter of all 30 blends from a time on, over the larger of the two dances'.
fn ratios(salsas: &[Motion], spectrum: Spectrum, coordinates: Coordinates, at_s: f64) -> Vec<f64> {
    let alignment = Alignment { at_s: [at_s; 2], ..Alignment::default() };
    let method = Method::Closed { amount: 0.5 };
    let options = InterpolateOptions { alignment, coordinates, spectrum, keep: None, method };
    let ratio = |a: &Motion, b: &Motion| interpolate(a, b, &options).unwrap().report.jitter_ratio.unwrap();
    let pairs = salsas.iter().flat_map(|a| salsas.iter().map(move |b| (a, b)));
    pairs.filter(|(a, b)| a.path != b.path).map(|(a, b)| ratio(a, b)).collect()
}

#[test]
fn blends_of_dancers_who_turn_are_calm() {
    let Some(salsas) = salsas("blends_of_dancers_who_turn_are_calm") else { return };
    // fitting bases takes its time
    let times = [(Spectrum::Dct, vec![2.0, 5.0, 7.0, 11.0, 13.0]), (Spectrum::Pca, vec![11.0])];
    for (spectrum, times) in times {
        for at_s in times {
            let ratios = ratios(&salsas, spectrum, Coordinates::Relative, at_s);
            let above = |bound: f64| ratios.iter().filter(|r| **r > bound).count();
            assert_eq!(ratios.len(), 30);
            assert!(above(JITTER_BOUND) <= 2 && above(1.25) == 0, "{spectrum:?} at {at_s} s: {ratios:.2?}");
        }
    }
    let raw = ratios(&salsas, Spectrum::Dct, Coordinates::Vectors, 11.0);
    assert!(raw.iter().filter(|r| **r > 2.0).count() >= 5, "rotation vectors flip: {raw:.2?}");
}
