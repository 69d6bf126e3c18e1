//! Secrets of 128 bits.

use crate::{Error, Result};

/// Letters of a secret as text.
const LETTERS: usize = 32;

/// A random number of 128 bits as 32 hexadecimal digits.
#[derive(Clone)]
pub struct Secret(String);

impl Secret {
    /// A new one, of the system's randomness.
    ///
    /// # Errors
    /// A system that has none.
    pub fn new() -> Result<Secret> {
        let mut bytes = [0; LETTERS / 2];
        getrandom::fill(&mut bytes).map_err(|e| {
            Error::missing("random numbers of the system", format!("the studio can't be kept to its user: {e}"))
        })?;
        Ok(Secret(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// Its text.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether `text` is this secret. It takes the same time for every text of one length.
    pub fn is(&self, text: &str) -> bool {
        let differences = self.0.bytes().zip(text.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
        // `zip` stops at the shorter: the lengths are no secret, the digits are
        text.len() == self.0.len() && std::hint::black_box(differences) == 0
    }
}

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Secret")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_secret_is_itself_alone() {
        let (a, b) = (Secret::new().unwrap(), Secret::new().unwrap());
        assert!(a.is(a.text()) && !a.is(b.text()) && !a.is("") && !a.is(&a.text()[1..]));
        assert!(!a.is(&format!("{}0", a.text())) && a.text().len() == LETTERS);
        assert_eq!(format!("{a:?}"), "Secret");
    }
}
