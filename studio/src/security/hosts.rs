//! The names under which the server answers, and whether a request comes from its own page.
//!
//! A page of another site reaches a local server by its address, or by a name that it points at it (DNS rebinding).
//! Names that aren't ours are refused, and so is every request that a browser doesn't mark as the page's own.

use axum::http::{HeaderMap, Method, header};
use std::net::IpAddr;

/// The hosts that a server answers for.
#[derive(Debug, Clone)]
pub struct Hosts {
    names: Vec<String>,
    /// How many of them are loopback's; the others are of `--bind`.
    loopback: usize,
}

impl Hosts {
    /// Loopback, and the names that `--bind` added, at a port.
    pub fn new(port: u16, bound: &[String]) -> Hosts {
        let local = ["127.0.0.1".to_owned(), "localhost".to_owned(), "[::1]".to_owned()];
        let with_port = |host: &String| {
            let is_v6 = host.parse::<IpAddr>().is_ok_and(|ip| ip.is_ipv6());
            let host = if is_v6 { format!("[{host}]") } else { host.to_ascii_lowercase() };
            // a browser leaves out the port of plain HTTP
            [Some(format!("{host}:{port}")), (port == 80).then_some(host)]
        };
        let loopback = local.iter().flat_map(with_port).flatten().count();
        Hosts { names: local.iter().chain(bound).flat_map(with_port).flatten().collect(), loopback }
    }

    /// Whether a `Host` header is one of ours.
    pub fn has(&self, host: &str) -> bool {
        self.names.iter().any(|name| name.eq_ignore_ascii_case(host))
    }

    /// Whether it is a name of `--bind`: to plain HTTP elsewhere than on loopback, browsers don't say where a request comes
    /// from.
    fn is_bound(&self, host: &str) -> bool {
        self.names[self.loopback..].iter().any(|name| name.eq_ignore_ascii_case(host))
    }

    /// Whether an `Origin` header is one of ours.
    fn is_origin(&self, origin: &str) -> bool {
        origin.strip_prefix("http://").is_some_and(|host| self.has(host))
    }

    /// Why a request is refused for where it comes from; `None` if it may pass. `is_page`: it is for the page
    /// itself, which a user may open by typing its address.
    pub fn refusal(&self, method: &Method, headers: &HeaderMap, is_page: bool) -> Option<&'static str> {
        let mut hosts = headers.get_all(header::HOST).iter();
        let host = hosts.next().and_then(|host| host.to_str().ok());
        // one Host exactly: proxies and servers disagree on which of two counts
        if hosts.next().is_some() || !host.is_some_and(|host| self.has(host)) {
            return Some("the Host header names another server; open the address that kinelm printed");
        }
        let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        let (site, origin) = (text("sec-fetch-site"), text("origin"));
        // an origin is never wrong on a request of ours, whatever else a client says
        if origin.is_some_and(|origin| !self.is_origin(origin)) {
            return Some("the request comes from another page");
        }
        let is_own = match site {
            Some(site) => site == "same-origin",
            // there a page of another site has no cookie of ours, and one of the same host can't read the answer; only
            // a POST changes anything, and has an origin
            None => origin.is_some() || (*method == Method::GET && host.is_some_and(|host| self.is_bound(host))),
        };
        let is_navigation = is_page && *method == Method::GET && text("sec-fetch-mode") == Some("navigate");
        let is_typed = is_navigation && matches!(site, Some("none" | "same-origin"));
        // a framed page could be clicked through; `frame-ancestors` forbids it too, in browsers that know it
        let is_framed =
            text("sec-fetch-dest").is_some_and(|dest| ["iframe", "frame", "embed", "object"].contains(&dest));
        (is_framed || !(is_own || is_typed)).then_some("the request comes from another page")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::{HeaderName, HeaderValue};

    fn refused(is_page: bool, pairs: &[(&str, &str)]) -> bool {
        let mut headers = HeaderMap::new();
        for (name, value) in pairs {
            headers.append(HeaderName::from_bytes(name.as_bytes()).unwrap(), HeaderValue::from_str(value).unwrap());
        }
        Hosts::new(8123, &["Box.local".into(), "fd00::1".into()]).refusal(&Method::GET, &headers, is_page).is_some()
    }

    #[test]
    fn only_our_own_page_passes() {
        let (host, own) = (("host", "127.0.0.1:8123"), ("sec-fetch-site", "same-origin"));
        assert!(!refused(false, &[host, own]) && !refused(false, &[("host", "LOCALHOST:8123"), own]));
        assert!(
            !refused(false, &[("host", "box.local:8123"), own]) && !refused(false, &[("host", "[fd00::1]:8123"), own])
        );
        for name in ["evil.example:8123", "127.0.0.1", "127.0.0.1:8124", "127.0.0.1:8123.evil.example", ""] {
            assert!(refused(false, &[("host", name), own]), "{name}");
        }
        assert!(refused(false, &[own]) && refused(false, &[host, host, own]));
        for site in ["cross-site", "same-site", "none", ""] {
            assert!(refused(false, &[host, ("sec-fetch-site", site)]), "{site}");
        }
        assert!(refused(false, &[host]), "a request that says nothing of where it comes from");
        let origin = |origin| refused(false, &[host, ("origin", origin)]);
        assert!(!origin("http://127.0.0.1:8123") && !origin("http://localhost:8123"));
        assert!(origin("null") && origin("http://127.0.0.1:9") && origin("https://127.0.0.1:8123") && origin(""));
        assert!(refused(false, &[host, own, ("origin", "http://evil.example")]));
        // browsers say nothing where it is neither loopback nor encrypted
        let bound = ("host", "box.local:8123");
        assert!(!refused(false, &[bound]) && !refused(true, &[bound]) && refused(false, &[bound, ("origin", "null")]));
        let mut headers = HeaderMap::new();
        headers.insert("host", HeaderValue::from_static("box.local:8123"));
        let hosts = Hosts::new(8123, &["box.local".into()]);
        assert!(hosts.refusal(&Method::POST, &headers, false).is_some(), "what changes something has an origin");
    }

    #[test]
    fn the_page_may_be_typed_but_not_linked_or_framed() {
        let (host, navigate) = (("host", "127.0.0.1:8123"), ("sec-fetch-mode", "navigate"));
        let page = |site, dest| refused(true, &[host, navigate, ("sec-fetch-site", site), ("sec-fetch-dest", dest)]);
        assert!(!page("none", "document") && !page("same-origin", "document"));
        assert!(page("cross-site", "document") && page("none", "iframe") && page("same-origin", "frame"));
        assert!(refused(true, &[host, ("sec-fetch-site", "none")]), "no navigation");
        assert!(refused(false, &[host, navigate, ("sec-fetch-site", "none")]), "not the page");
    }
}
