//! What proves that a client may give orders.

use rustix::rand::{GetRandomFlags, getrandom};
use std::io;

/// Random bytes of a token.
const BYTES: usize = 16;

/// A secret of one server, as it stands in the address of its page.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct Token(String);

impl core::fmt::Debug for Token {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Token")
    }
}

impl Token {
    /// One that cannot be guessed.
    pub(super) fn random() -> io::Result<Self> {
        let mut bytes = [0; BYTES];
        let count = getrandom(&mut bytes, GetRandomFlags::empty())?;
        if count != BYTES {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(Self(format!("{:032x}", u128::from_ne_bytes(bytes))))
    }

    /// One that was made before; none if it is no token.
    pub(super) fn known(text: &str) -> Option<Self> {
        let is_one = text.len() == 2 * BYTES && text.bytes().all(|b| b.is_ascii_hexdigit());
        is_one.then(|| Self(text.to_owned()))
    }

    /// As shown to the user who may give orders.
    pub(super) fn as_str(&self) -> &str {
        &self.0
    }

    /// True if a client has shown it; takes as long for any guess.
    pub(super) fn is(&self, shown: &str) -> bool {
        // Hashes are compared in constant time.
        blake3::hash(shown.as_bytes()) == blake3::hash(self.0.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::Token;

    #[test]
    fn a_token_is_itself_alone_and_shows_nothing_in_a_log() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        assert_eq!(one.as_str().len(), 32);
        assert!(one.is(one.as_str()) && !one.is(other.as_str()));
        assert!(
            !one.is("") && !one.is(&one.as_str()[..31]) && !one.is(&format!("{}0", one.as_str()))
        );
        assert!(!format!("{one:?}").contains(one.as_str()));
    }
}
