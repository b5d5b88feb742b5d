//! Who may talk to the server: whoever knows its token, from its own page.

use std::net::{IpAddr, SocketAddr};

use axum::http::{
    HeaderMap,
    header::{HOST, ORIGIN},
};
use multiscopic::{Error, Result};

/// Bytes of the token.
const TOKEN_BYTES: usize = 16;

/// The token, and the addresses under which the server may be asked for.
#[derive(Debug)]
pub struct Gate {
    listening: SocketAddr,
    token: String,
}

impl Gate {
    /// A gate with a token that nobody can guess.
    pub fn new(listening: SocketAddr) -> Result<Gate> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| Error::Usage(format!("the system gives no random numbers: {error}")))?;
        Ok(Gate { listening, token: bytes.iter().map(|byte| format!("{byte:02x}")).collect() })
    }

    /// The address of the page.
    pub fn address(&self) -> String {
        format!("http://{}/{}/", self.listening, self.token)
    }

    /// Returns true if this is the token. It takes the same time for all tokens of its length.
    pub fn is_token(&self, token: &str) -> bool {
        let differences = token.bytes().zip(self.token.bytes()).fold(0, |bits, (a, b)| bits | (a ^ b));
        token.len() == self.token.len() && differences == 0
    }

    /// Returns the reason to refuse a request for where it is from and whom it asks, if there is one.
    pub fn refusal(&self, headers: &HeaderMap) -> Option<&'static str> {
        let mut hosts = headers.get_all(HOST).iter();
        let (Some(host), None) = (hosts.next().and_then(|host| host.to_str().ok()), hosts.next()) else {
            return Some("there must be one Host\n");
        };
        if !self.is_host(host) {
            return Some("the Host is not the address that this program has written to its terminal\n");
        }
        let mut origins = headers.get_all(ORIGIN).iter();
        let is_own = origins.all(|origin| origin.to_str().is_ok_and(|origin| origin.strip_prefix("http://") == Some(host)));
        (!is_own).then_some("the Origin is another page\n")
    }

    /// The same for sockets, which browsers never open without an Origin.
    pub fn refusal_of_socket(&self, headers: &HeaderMap) -> Option<&'static str> {
        match headers.contains_key(ORIGIN) {
            true => self.refusal(headers),
            false => Some("there must be an Origin\n"),
        }
    }

    /// Returns true if a host is this server. Names other than `localhost` are not: whoever owns one can point it here, and
    /// read with a page of their own what a browser gets from it.
    fn is_host(&self, host: &str) -> bool {
        let Some((name, port)) = host.rsplit_once(':') else { return false };
        let is_loopback = self.listening.ip().is_loopback();
        let is_name = match name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>() {
            Ok(address) if is_loopback => address.is_loopback(),
            Ok(_) => true,
            Err(_) => name == "localhost" && (is_loopback || self.listening.ip().is_unspecified()),
        };
        is_name && port.parse() == Ok(self.listening.port())
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn headers(pairs: &[(axum::http::HeaderName, &'static str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.clone(), HeaderValue::from_static(value))).collect()
    }

    #[test]
    fn tokens_are_long_and_new_each_time() {
        let gate = Gate::new("127.0.0.1:4000".parse().unwrap()).unwrap();
        let other = Gate::new("127.0.0.1:4000".parse().unwrap()).unwrap();
        assert_eq!(gate.token.len(), 32);
        assert!(gate.is_token(&gate.token) && !gate.is_token(&other.token));
        assert!(!gate.is_token("") && !gate.is_token(&gate.token[1..]) && !gate.is_token(&format!("{}0", gate.token)));
        assert_eq!(gate.address(), format!("http://127.0.0.1:4000/{}/", gate.token));
    }

    #[test]
    fn hosts_are_addresses_of_this_server() {
        let is_host = |listening: &str, host: &str| Gate::new(listening.parse().unwrap()).unwrap().is_host(host);
        for host in ["127.0.0.1:4000", "localhost:4000", "[::1]:4000"] {
            assert!(is_host("127.0.0.1:4000", host), "{host}");
        }
        for host in
            ["127.0.0.1", "127.0.0.1:4001", "localhost:", "evil.example:4000", "192.168.0.2:4000", "localhost.evil:4000", ""]
        {
            assert!(!is_host("127.0.0.1:4000", host), "{host}");
        }
        assert!(is_host("0.0.0.0:4000", "192.168.0.2:4000") && is_host("0.0.0.0:4000", "localhost:4000"));
        assert!(!is_host("0.0.0.0:4000", "evil.example:4000") && !is_host("192.168.0.2:4000", "localhost:4000"));
    }

    #[test]
    fn origins_are_this_page() {
        let gate = Gate::new("127.0.0.1:4000".parse().unwrap()).unwrap();
        let host = (HOST, "127.0.0.1:4000");
        let own = headers(&[host.clone(), (ORIGIN, "http://127.0.0.1:4000")]);
        assert_eq!((gate.refusal(&own), gate.refusal_of_socket(&own)), (None, None));
        assert_eq!(gate.refusal(&headers(std::slice::from_ref(&host))), None);
        assert!(gate.refusal_of_socket(&headers(std::slice::from_ref(&host))).is_some());
        for origin in ["null", "https://127.0.0.1:4000", "http://localhost:4000", "http://127.0.0.1:4001", "http://evil.example"]
        {
            assert!(gate.refusal(&headers(&[host.clone(), (ORIGIN, origin)])).is_some(), "{origin}");
        }
        assert!(gate.refusal(&headers(&[])).is_some());
    }
}
