//! Numbers as matrices store them: f32, signed bytes, half floats, widened in registers.

use pulp::Simd;

/// A number as matrices store it.
pub(crate) trait Element: bytemuck::Pod + Send + Sync {
    /// Factor of the left operand, which makes up for the division of [`Element::pair`].
    const LEFT: f32;

    /// Two vectors of numbers, divided by [`Element::LEFT`].
    fn pair<S: Simd>(numbers: &[Self]) -> [S::f32s; 2];
}

impl Element for f32 {
    const LEFT: f32 = 1.0;

    #[inline(always)]
    fn pair<S: Simd>(numbers: &[f32]) -> [S::f32s; 2] {
        let (vectors, _) = S::as_simd_f32s(numbers);
        [vectors[0], vectors[1]]
    }
}

impl Element for i8 {
    const LEFT: f32 = 1.0;

    #[inline(always)]
    fn pair<S: Simd>(numbers: &[i8]) -> [S::f32s; 2] {
        widened::<S, i8>(numbers, f32::from)
    }
}

/// The bits of a half float.
impl Element for u16 {
    /// 2^112: half floats have exponents that are less by as much.
    const LEFT: f32 = f32::from_bits((127 + 112) << 23);

    #[inline(always)]
    fn pair<S: Simd>(numbers: &[u16]) -> [S::f32s; 2] {
        // sign, exponent and mantissa have the same order: they are shifted, and the sign's copies masked out;
        // subnormal halves need no branch of their own, infinity becomes 2^16 / LEFT, NaN a number beyond
        widened::<S, u16>(numbers, |bits| f32::from_bits((i32::from(bits as i16) << 13) as u32 & 0x8fff_e000))
    }
}

/// Lanes of the widest vector there is.
const MOST_LANES: usize = 16;

/// Each number by `widen`. Being compiled inside the kernel, the loop becomes vector instructions.
#[inline(always)]
fn widened<S: Simd, E: Copy>(numbers: &[E], widen: impl Fn(E) -> f32) -> [S::f32s; 2] {
    let mut wide = [0.0; 2 * MOST_LANES];
    let wide = &mut wide[..2 * S::F32_LANES];
    for (wide, &number) in wide.iter_mut().zip(&numbers[..2 * S::F32_LANES]) {
        *wide = widen(number);
    }
    let (vectors, _) = S::as_simd_f32s(wide);
    [vectors[0], vectors[1]]
}
