//! Access control: who may see the page, and who may send commands.
//!
//! A foreign page, opened in a browser on this machine, can send requests here. It cannot choose
//! `Host` and `Origin`, and it does not know the token.

use hyper::HeaderMap;
use hyper::header::{CONTENT_TYPE, HOST, ORIGIN};
use std::io;
use std::net::{IpAddr, SocketAddr};

/// The rules of one server.
#[derive(Debug, Clone)]
pub(super) struct Guard {
    loopback: bool,
    token: String,
}

impl Guard {
    /// # Errors
    /// If the operating system provides no random numbers.
    pub(super) fn new(address: SocketAddr) -> io::Result<Self> {
        Ok(Self {
            loopback: address.ip().is_loopback(),
            token: token()?,
        })
    }

    /// The token that the page's address must contain to see it from other machines, and to send
    /// commands.
    pub(super) fn token(&self) -> &str {
        &self.token
    }

    /// True if the token is required to see anything.
    pub(super) fn is_closed(&self) -> bool {
        !self.loopback
    }

    /// A request must be addressed to this server and, if it comes from a page, come from the
    /// server's own page.
    pub(super) fn admits(&self, headers: &HeaderMap) -> Result<(), &'static str> {
        let mut hosts = headers.get_all(HOST).iter();
        let host = hosts.next().and_then(|host| host.to_str().ok()).unwrap_or("");
        if host.is_empty() || hosts.next().is_some() {
            return Err("expected one Host header");
        }
        // A foreign name that resolves to 127.0.0.1 would give its page the same origin: DNS
        // rebinding.
        if self.loopback && !is_loopback_name(host_name(host)) {
            return Err("expected localhost, 127.0.0.1 or [::1] as Host");
        }
        match headers.get(ORIGIN) {
            None => Ok(()),
            Some(origin) => {
                let origin = origin.to_str().unwrap_or("");
                let authority = origin
                    .strip_prefix("http://")
                    .or_else(|| origin.strip_prefix("https://"));
                match authority.is_some_and(|authority| authority.eq_ignore_ascii_case(host)) {
                    true => Ok(()),
                    false => Err("the request comes from a page of another origin"),
                }
            }
        }
    }

    /// True if the token is this server's; compared in constant time.
    pub(super) fn knows(&self, token: Option<&str>) -> bool {
        let given = token.unwrap_or("").as_bytes();
        let own = self.token.as_bytes();
        let differences = own.iter().zip(given).fold(0, |all, (a, b)| all | (a ^ b));
        given.len() == own.len() && differences == 0
    }

    /// A form of another page cannot send this content type without a preflight request.
    pub(super) fn is_json(headers: &HeaderMap) -> bool {
        let kind = headers
            .get(CONTENT_TYPE)
            .and_then(|kind| kind.to_str().ok())
            .unwrap_or("");
        let kind = kind.split(';').next().unwrap_or("").trim();
        kind.eq_ignore_ascii_case("application/json")
    }
}

/// The name without its port.
fn host_name(host: &str) -> &str {
    match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or(""),
        None => host.split(':').next().unwrap_or(""),
    }
}

fn is_loopback_name(name: &str) -> bool {
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// 128 bits from the operating system's random generator.
fn token() -> io::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)
        .map_err(|e| io::Error::other(format!("no random numbers for the token of the page: {e}")))?;
    Ok(format!("{:032x}", u128::from_ne_bytes(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(list: &[(&'static str, &str)]) -> HeaderMap {
        let mut map = HeaderMap::new();
        for (name, value) in list {
            map.append(*name, value.parse().unwrap());
        }
        map
    }

    #[test]
    fn fault_requests_for_others_and_from_pages_of_others_are_refused() {
        let guard = Guard::new("127.0.0.1:8080".parse().unwrap()).unwrap();
        for (list, admitted) in [
            (&[("host", "127.0.0.1:8080")][..], true),
            (&[("host", "localhost:9000")], true),
            (&[("host", "[::1]:8080")], true),
            (&[("host", "127.0.0.1:8080"), ("origin", "http://127.0.0.1:8080")], true),
            (&[], false),
            (&[("host", "evil.example:8080")], false),
            (&[("host", "127.0.0.1.evil.example")], false),
            (&[("host", "localhost"), ("host", "localhost")], false),
            (&[("host", "127.0.0.1:8080"), ("origin", "http://evil.example")], false),
            (&[("host", "127.0.0.1:8080"), ("origin", "null")], false),
            (
                &[("host", "127.0.0.1:8080"), ("origin", "http://127.0.0.1:9999")],
                false,
            ),
        ] {
            assert_eq!(guard.admits(&headers(list)).is_ok(), admitted, "{list:?}");
        }
        // On a network any name may lead here, so the token decides.
        let open = Guard::new("0.0.0.0:8080".parse().unwrap()).unwrap();
        assert!(open.is_closed() && open.admits(&headers(&[("host", "robot.lab:8080")])).is_ok());
    }

    #[test]
    fn prop_tokens_are_long_and_new_each_time_and_only_the_own_one_opens() {
        let address = "127.0.0.1:0".parse().unwrap();
        let (one, other) = (Guard::new(address).unwrap(), Guard::new(address).unwrap());
        assert_eq!(one.token().len(), 32);
        assert_ne!(one.token(), other.token());
        assert!(one.knows(Some(one.token())));
        for wrong in [None, Some(""), Some(other.token()), Some(&one.token()[1..])] {
            assert!(!one.knows(wrong));
        }
    }
}
