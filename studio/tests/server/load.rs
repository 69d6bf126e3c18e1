//! Many requests at once, and many that are none.

use super::client::send;
use super::place::Place;
use std::io::Write;
use std::net::TcpStream;

/// Numbers that follow from a seed (xorshift).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self, below: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % below as u64) as usize
    }
}

#[test]
fn two_hundred_requests_at_once_are_answered() {
    let place = Place::new();
    let paths = ["/api/state", "/", "/api/timeline", "/api/none"];
    std::thread::scope(|scope| {
        for n in 0..200 {
            let browser = place.browser.clone();
            scope.spawn(move || {
                let answer = browser.get(paths[n % paths.len()]);
                assert_eq!(answer.status, if n % paths.len() == 3 { 404 } else { 200 });
            });
        }
    });
    assert_eq!(place.browser.get("/api/state").status, 200);
}

#[test]
fn five_hundred_malformed_requests_leave_it_alive() {
    let place = Place::new();
    let port = place.browser.port;
    let whole = format!("{}Content-Length: 2\r\n\r\n{{}}", place.browser.head("POST", "/api/make")).into_bytes();
    let heads = [
        "GET",
        "GET / HTTP/9.9\r\n\r\n",
        "\r\n\r\n\r\n",
        "GET http://evil.example/ HTTP/1.1\r\nHost: evil.example\r\n\r\n",
        "POST /api/make HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        "POST /api/make HTTP/1.1\r\nContent-Length: 99999999999999999999\r\n\r\n",
        "POST /api/make HTTP/1.1\r\nTransfer-Encoding: chunked\r\nContent-Length: 5\r\n\r\nzz\r\n",
        "GET /%ff%fe%00 HTTP/1.1\r\nHost: \u{1}\r\n\r\n",
        "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        "OPTIONS * HTTP/1.1\r\nHost: a\r\n\r\n",
    ];
    let mut numbers = Numbers(88_172_645_463_325_252);
    for n in 0..500 {
        let bytes = match n % 5 {
            0 => heads[n / 5 % heads.len()].as_bytes().to_vec(),
            // a good one with wrong bytes in it
            1 | 2 => {
                let mut bytes = whole.clone();
                for _ in 0..=numbers.next(6) {
                    let at = numbers.next(bytes.len());
                    bytes[at] = numbers.next(256) as u8;
                }
                bytes
            }
            // or cut off
            3 => whole[..numbers.next(whole.len())].to_vec(),
            _ => (0..numbers.next(2000)).map(|_| numbers.next(256) as u8).collect(),
        };
        let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        let _ = stream.write_all(&bytes);
        let _ = stream.shutdown(std::net::Shutdown::Write);
    }
    assert_eq!(place.browser.get("/api/state").status, 200);
}

#[test]
fn malformed_json_is_an_error_with_words() {
    let place = Place::new();
    let browser = &place.browser;
    let routes =
        ["/api/make", "/api/timeline", "/api/search", "/api/music", "/api/dances/d1/keep", "/api/clips/c1/reading"];
    for path in routes {
        for body in
            ["{", "null", "[]", "3", "\"a\"", "{\"a\": 1}", "\u{0}", "{\"kind\": {}}", "{\"edits\": [{\"op\": \"x\"}]}"]
        {
            let answer = browser.post_bytes(path, body.as_bytes());
            assert!([400, 404].contains(&answer.status), "{path} {body}: {answer:?}");
            assert!(!answer.error().is_empty());
        }
    }
    let none = send(browser.port, format!("{}\r\n", browser.head("PATCH", "/api/state")).as_bytes()).unwrap();
    assert_eq!(none.status, 405);
}
