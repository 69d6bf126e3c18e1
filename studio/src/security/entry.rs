//! The way in: a token in a redirect file, exchanged for a cookie.
//!
//! The file is of mode 0600, so the token is neither in the list of processes nor in a shell's history. A token is
//! taken once; then the file gets the next one, so that opening it again works.

use super::secret::Secret;
use crate::{Error, Result};
use kinelm_store::part::PartFile;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Browsers that are let in at a time; a new one takes the place of the first.
const MOST_COOKIES: usize = 16;

/// The token that opens the door, and the cookies of those who came in.
#[derive(Debug)]
pub struct Entry {
    file: PathBuf,
    /// The server's address: `http://127.0.0.1:PORT`.
    address: String,
    name: String,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    token: Secret,
    cookies: Vec<Secret>,
}

impl Entry {
    /// Writes the redirect file.
    ///
    /// # Errors
    /// No randomness; I/O errors.
    pub fn new(file: &Path, address: &str, port: u16) -> Result<Entry> {
        let state = Mutex::new(State { token: Secret::new()?, cookies: Vec::new() });
        // cookies know no ports: two studios on one machine need two names
        let name = format!("kinelm_studio_{port}");
        let entry = Entry { file: file.into(), address: address.into(), name, state };
        entry.write(&entry.state().token)?;
        Ok(entry)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the file with a token, so that nobody else can read it at any moment.
    fn write(&self, token: &Secret) -> Result<()> {
        let page = format!(
            "<!doctype html><meta charset=\"utf-8\"><meta name=\"referrer\" content=\"no-referrer\"><title>kinelm studio</title>\n\
             <link rel=\"icon\" href=\"data:,\">\n\
             <meta http-equiv=\"refresh\" content=\"0; url={}/enter?token={}\">\n",
            self.address,
            token.text()
        );
        let mut part = PartFile::create_private(&self.file)?;
        part.write(page.as_bytes())?;
        Ok(part.name(&self.file)?)
    }

    /// Exchanges the token for a cookie, as a header has it; the token is used up.
    ///
    /// # Errors
    /// [`Error::Refused`] for another token; those of [`Entry::new`].
    pub fn enter(&self, token: &str) -> Result<String> {
        let mut state = self.state();
        if !state.token.is(token) {
            let what = "this address was used already, or is of another start; open the file again that kinelm named";
            return Err(Error::Refused(what.into()));
        }
        // another secret than the token, which a browser has in its history
        let cookie = Secret::new()?;
        let header = format!("{}={}; HttpOnly; SameSite=Strict; Path=/", self.name, cookie.text());
        // the file has the next token before this one is used up
        let next = Secret::new()?;
        self.write(&next)?;
        state.cookies.push(cookie);
        state.token = next;
        if state.cookies.len() > MOST_COOKIES {
            state.cookies.remove(0);
        }
        Ok(header)
    }

    /// Whether a `Cookie` header has one of our cookies.
    pub fn knows(&self, header: &str) -> bool {
        let own = header.split(';').filter_map(|pair| pair.trim().split_once('='));
        let mut own = own.filter(|(name, _)| *name == self.name);
        let state = self.state();
        // all are compared, so that the time says nothing of which one fits
        own.any(|(_, value)| state.cookies.iter().fold(false, |known, cookie| known | cookie.is(value)))
    }

    /// Removes the file, where the server ends.
    pub fn close(&self) {
        let _ = fs::remove_file(&self.file);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_taken_once_and_the_file_has_the_next() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("open.html");
        let entry = Entry::new(&file, "http://127.0.0.1:1", 1).unwrap();
        let token = || {
            let page = fs::read_to_string(&file).unwrap();
            page.split("token=").nth(1).unwrap()[..32].to_owned()
        };
        #[cfg(unix)]
        assert_eq!(std::os::unix::fs::PermissionsExt::mode(&fs::metadata(&file).unwrap().permissions()) & 0o777, 0o600);
        let first = token();
        let cookie = entry.enter(&first).unwrap();
        assert!(cookie.ends_with("; HttpOnly; SameSite=Strict; Path=/"), "{cookie}");
        assert_eq!(entry.enter(&first).unwrap_err().status(), 403);
        let pair = cookie.split(';').next().unwrap();
        assert!(entry.knows(pair) && entry.knows(&format!("a=b; {pair};c")) && !entry.knows(&pair.to_uppercase()));
        assert!(!entry.knows("") && !entry.knows("kinelm_studio_1=") && !entry.knows("kinelm_studio_1"));
        for _ in 0..MOST_COOKIES {
            entry.enter(&token()).unwrap();
        }
        assert!(!entry.knows(pair), "the first browser is out");
    }
}
