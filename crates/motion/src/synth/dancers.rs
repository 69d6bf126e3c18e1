//! The dancers, who perform the same figures with different habits.

/// A dancer's habits.
pub struct Dancer {
    pub name: &'static str,
    /// Amplitude of the movements, relative to the figure's.
    pub amplitude: f64,
    /// Tempo relative to the genre's.
    pub tempo: f64,
    /// Delay of hands and head after the feet, seconds; negative if they are ahead.
    pub lag_s: f64,
    /// Softness relative to the genre's.
    pub softness: f64,
    /// Shortening (positive) or lengthening of the second half of each beat, in beats.
    pub shuffle: f64,
    /// Half the distance between the feet when standing, metres.
    pub stance_m: f64,
    /// Forward bow of the chest, radians.
    pub bow: f64,
}

/// All dancers.
pub const DANCERS: [Dancer; 3] = [
    // large and exact
    Dancer {
        name: "ash",
        amplitude: 1.12,
        tempo: 1.0,
        lag_s: 0.0,
        softness: 0.9,
        shuffle: 0.0,
        stance_m: 0.125,
        bow: -0.03,
    },
    // small, early, light
    Dancer {
        name: "birch",
        amplitude: 0.78,
        tempo: 1.05,
        lag_s: -0.06,
        softness: 0.8,
        shuffle: 0.05,
        stance_m: 0.1,
        bow: 0.0,
    },
    // heavy and late
    Dancer {
        name: "cedar",
        amplitude: 0.96,
        tempo: 0.94,
        lag_s: 0.13,
        softness: 1.3,
        shuffle: -0.06,
        stance_m: 0.15,
        bow: 0.07,
    },
];
