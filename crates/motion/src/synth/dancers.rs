//! Who dances: people who do the same figures each in their own way.

/// A dancer's habits.
pub struct Dancer {
    pub name: &'static str,
    /// Size of the movements; 1 is as the figure says.
    pub amplitude: f64,
    /// Times the genre's tempo.
    pub tempo: f64,
    /// Seconds that hands and head come after the feet; negative is before them.
    pub lag_s: f64,
    /// Times the genre's softness.
    pub softness: f64,
    /// Second half of each beat shortened (positive) or lengthened, in parts of a beat.
    pub shuffle: f64,
    /// Half the distance between the feet at ease, metres.
    pub stance_m: f64,
    /// Carriage of the chest: radians bowed forward.
    pub bow: f64,
}

/// The dancers, by name.
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
