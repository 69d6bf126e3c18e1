//! From one window towards the spectrum of another.
//!
//! Letters: C channels, N frames of a window, n numbers of its feature. A window x is (C, N), radians; F(x) its feature.
//! It minimizes `L(x) = sum (F(x) - target)^2 / n` with `target = F(a) + strength (F(b) - F(a))`, from x = a on.

use crate::{Error, Result, Transform};

/// How the window gets to its goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The limit of plain descent, computed at once: `x = a + amount (F back)(F(b) - F(a))`. Linear features only.
    Closed {
        /// 0 gives a, 1 gives b's feature.
        amount: f64,
    },
    /// Gradient descent with Adam's steps; the rate is [`Descent::ADAM_RATE`] if not given.
    Adam(Descent),
    /// Gradient descent as it is; if not given, the rate is the one that covers 99 % of the distance.
    Plain(Descent),
}

/// Options of gradient descent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Descent {
    /// The goal's place on the line from a's feature (0) to b's (1).
    pub strength: f64,
    /// Step size. Adam: radians that a number moves in the first step, root mean square.
    pub rate: Option<f64>,
    /// Steps.
    pub steps: usize,
}

/// Share of the distance to the goal that plain descent covers if no rate is given.
const PLAIN_SHARE: f64 = 0.99;

impl Method {
    /// Fills in the rate, for features of `n` numbers.
    pub(crate) fn resolve(self, n: usize) -> Method {
        let with = |d: Descent, rate: f64| Descent { rate: Some(d.rate.unwrap_or(rate)), ..d };
        match self {
            Method::Closed { .. } => self,
            Method::Adam(d) => Method::Adam(with(d, Descent::ADAM_RATE)),
            Method::Plain(d) => Method::Plain(with(d, Descent::rate_for(PLAIN_SHARE, n, d.steps))),
        }
    }
}

impl Descent {
    /// Steps unless said otherwise.
    pub const STEPS: usize = 500;
    /// Adam's rate unless said otherwise.
    pub const ADAM_RATE: f64 = 0.01;
    /// [`Descent::strength`] by default: half way.
    pub const STRENGTH: f64 = 0.5;

    /// The rate of plain descent at which `steps` steps go this share of the way, for n numbers of a feature: from
    /// `share = 1 - (1 - 2 rate / n)^steps`.
    pub(crate) fn rate_for(share: f64, n: usize, steps: usize) -> f64 {
        0.5 * n as f64 * (1.0 - (1.0 - share).powf(1.0 / steps.max(1) as f64))
    }

    /// The rate, after checking rate and strength.
    fn check(&self) -> Result<f64> {
        let rate = self.rate.unwrap_or_default();
        check_share("strength", self.strength)?;
        if !(rate > 0.0 && rate.is_finite()) {
            return Err(Error::invalid_parameter("rate", rate, "a number above 0"));
        }
        Ok(rate)
    }
}

/// The result of a descent.
#[derive(Debug, Clone, PartialEq)]
pub struct Moved {
    /// (C, N) the window.
    pub window: Vec<f64>,
    /// The loss where the way begins, and where it ends.
    pub loss: [f64; 2],
}

/// The way from window `a` towards the feature of window `b`, both (C, N).
///
/// For DCT and PCA plain descent moves every number of the feature straight (the others stay a's): after all steps by
/// `strength (1 - (1 - 2 rate / n)^steps)` of the way, which [`Method::Closed`] computes directly. Adam's
/// steps, of one size for all numbers, go the same way sooner. Magnitudes leave the phase free and have no such form.
/// Source: docs/interpolation.md; Kingma and Ba, "Adam" (2015), with its betas 0.9 and 0.999, but one size of the gradient.
///
/// # Errors
/// The closed form of a transform that isn't linear; amounts outside 0 to 1; a rate that is none, or so large that the
/// loss grows beyond all numbers.
///
/// # Panics
/// When the windows aren't of one shape.
pub fn descend(transform: &Transform, channels: usize, a: &[f64], b: &[f64], method: Method) -> Result<Moved> {
    assert_eq!(a.len(), b.len(), "windows of one shape");
    let (from, to) = (transform.feature(a, channels), transform.feature(b, channels));
    let goal = |share: f64| {
        let target = from.iter().zip(&to).map(|(f, t)| f + share * (t - f)).collect();
        Goal { transform, channels, target }
    };
    match method.resolve(from.len()) {
        Method::Closed { amount } => {
            check_share("amount", amount)?;
            if matches!(transform, Transform::Stft(_)) {
                let why = "magnitudes leave the phase free, so they have no closed form; give `strength` and `steps`, or take DCT or PCA";
                return Err(Error::unsupported_parameter("amount", why));
            }
            // the loss of the closed form is to b itself, whatever the amount
            let goal = Goal { transform, channels, target: to };
            let moved: Vec<f64> = goal.target.iter().zip(&from).map(|(t, f)| amount * (t - f)).collect();
            let step = transform.feature_back(a, channels, &moved);
            let window: Vec<f64> = a.iter().zip(step).map(|(a, s)| a + s).collect();
            let loss = [goal.loss_and_gradient(a).0, goal.loss_and_gradient(&window).0];
            Ok(Moved { window, loss })
        }
        Method::Adam(descent) => {
            let (rate, mut adam) = (descent.check()?, Adam::new(a.len()));
            goal(descent.strength).walk(a, descent, &mut |x, gradient| adam.step(x, gradient, rate))
        }
        Method::Plain(descent) => {
            let rate = descent.check()?;
            goal(descent.strength).walk(a, descent, &mut |x, gradient| {
                x.iter_mut().zip(gradient).for_each(|(x, g)| *x -= rate * g);
            })
        }
    }
}

fn check_share(name: &'static str, amount: f64) -> Result<()> {
    if (0.0..=1.0).contains(&amount) {
        return Ok(());
    }
    Err(Error::invalid_parameter(name, amount, "0 (the first's spectrum) to 1 (the second's)"))
}

/// A feature to come to.
struct Goal<'a> {
    transform: &'a Transform,
    channels: usize,
    target: Vec<f64>,
}

impl Goal<'_> {
    /// L(x) and its gradient (C, N).
    fn loss_and_gradient(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let feature = self.transform.feature(x, self.channels);
        let n = feature.len() as f64;
        let off: Vec<f64> = feature.iter().zip(&self.target).map(|(f, t)| f - t).collect();
        let slopes: Vec<f64> = off.iter().map(|d| 2.0 * d / n).collect();
        (off.iter().map(|d| d * d).sum::<f64>() / n, self.transform.feature_back(x, self.channels, &slopes))
    }

    fn walk(&self, from: &[f64], descent: Descent, step: &mut dyn FnMut(&mut [f64], &[f64])) -> Result<Moved> {
        let mut x = from.to_vec();
        let first = self.loss_and_gradient(&x).0;
        for _ in 0..descent.steps {
            let (_, gradient) = self.loss_and_gradient(&x);
            step(&mut x, &gradient);
        }
        let last = self.loss_and_gradient(&x).0;
        // plain descent with a rate above n moves away from its goal with every step
        if !last.is_finite() || x.iter().any(|x| !x.is_finite()) {
            let rate = descent.rate.unwrap_or_default();
            return Err(Error::invalid_parameter("rate", rate, "a smaller one, at which the loss stays finite"));
        }
        Ok(Moved { window: x, loss: [first, last] })
    }
}

/// Adam's steps, with one mean of squares for all numbers.
///
/// Adam divides every number's step by the size of its own gradients. Over time that squares a wave: what is moved leaves the
/// band whose loss it lowers, and the dance shakes: 38 times as much as the two of the tests, where this has 1.2 times.
/// Divided by one size, steps go the gradient's way.
struct Adam {
    mean: Vec<f64>,
    square: f64,
    steps: i32,
}

impl Adam {
    fn new(n: usize) -> Adam {
        Adam { mean: vec![0.0; n], square: 0.0, steps: 0 }
    }

    fn step(&mut self, x: &mut [f64], gradient: &[f64], rate: f64) {
        self.steps += 1;
        // Kingma and Ba's defaults
        let (b1, b2) = (0.9f64, 0.999f64);
        let square = gradient.iter().map(|g| g * g).sum::<f64>() / gradient.len().max(1) as f64;
        self.square = b2 * self.square + (1.0 - b2) * square;
        let size = (self.square / (1.0 - b2.powi(self.steps))).sqrt();
        // both corrections at once, since one size divides all numbers
        let rate = rate / (1.0 - b1.powi(self.steps)) / (size + 1e-8);
        for ((x, mean), g) in x.iter_mut().zip(&mut self.mean).zip(gradient) {
            *mean = b1 * *mean + (1.0 - b1) * g;
            *x -= rate * *mean;
        }
    }
}

#[cfg(test)]
mod tests;
