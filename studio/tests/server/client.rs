//! A client that sends what it is told, byte for byte.

use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// An answer.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(own, _)| own == name).map(|(_, value)| &**value)
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}", self.text()))
    }

    /// The text of its error.
    pub fn error(&self) -> String {
        self.json()["error"]["text"].as_str().unwrap_or_else(|| panic!("no error: {}", self.text())).to_owned()
    }
}

/// Sends bytes and reads the answer until the server closes; `None` where it closes without one.
pub fn send(port: u16, bytes: &[u8]) -> Option<Answer> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    // a server that refuses the head needn't read the rest
    let _ = stream.write_all(bytes);
    answer(&mut BufReader::new(stream))
}

fn answer(from: &mut impl BufRead) -> Option<Answer> {
    let mut line = String::new();
    from.read_line(&mut line).ok()?;
    let status = line.split(' ').nth(1)?.parse().ok()?;
    let headers = headers(from)?;
    let header = |name: &str| headers.iter().find(|(own, _)| own == name).map(|(_, value)| value.clone());
    let mut body = Vec::new();
    match header("content-length").map(|length| length.parse::<usize>().unwrap()) {
        Some(length) => {
            body.resize(length, 0);
            from.read_exact(&mut body).ok()?;
        }
        None if header("transfer-encoding").is_some() => {
            while let Some(chunk) = chunk(from).filter(|chunk| !chunk.is_empty()) {
                body.extend(chunk);
            }
        }
        None => {
            from.read_to_end(&mut body).ok()?;
        }
    }
    Some(Answer { status, headers, body })
}

fn headers(from: &mut impl BufRead) -> Option<Vec<(String, String)>> {
    let mut headers = Vec::new();
    loop {
        let mut line = String::new();
        from.read_line(&mut line).ok()?;
        if line.trim().is_empty() {
            return Some(headers);
        }
        let (name, value) = line.split_once(':')?;
        headers.push((name.to_lowercase(), value.trim().to_owned()));
    }
}

fn chunk(from: &mut impl BufRead) -> Option<Vec<u8>> {
    let mut line = String::new();
    from.read_line(&mut line).ok()?;
    let length = usize::from_str_radix(line.trim(), 16).ok()?;
    let mut bytes = vec![0; length + 2];
    from.read_exact(&mut bytes).ok()?;
    bytes.truncate(length);
    Some(bytes)
}

/// A browser that was let in.
#[derive(Debug, Clone)]
pub struct Browser {
    pub port: u16,
    pub cookie: String,
}

impl Browser {
    /// Opens a redirect file.
    pub fn enter(file: &std::path::Path) -> Browser {
        let (port, token) = token(file);
        let host = format!("127.0.0.1:{port}");
        let request = format!("GET /enter?token={token} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        let answer = send(port, request.as_bytes()).unwrap();
        assert_eq!(answer.status, 303, "{answer:?}");
        let cookie = answer.header("set-cookie").unwrap().split(';').next().unwrap().to_owned();
        Browser { port, cookie }
    }

    /// The head of a request, as the page's own would have it.
    pub fn head(&self, method: &str, path: &str) -> String {
        format!(
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nCookie: {}\r\nSec-Fetch-Site: same-origin\r\nConnection: close\r\n",
            self.port, self.cookie
        )
    }

    pub fn get(&self, path: &str) -> Answer {
        send(self.port, format!("{}\r\n", self.head("GET", path)).as_bytes()).unwrap()
    }

    pub fn post_bytes(&self, path: &str, body: &[u8]) -> Answer {
        let head = format!("{}Content-Length: {}\r\n\r\n", self.head("POST", path), body.len());
        send(self.port, &[head.as_bytes(), body].concat()).unwrap()
    }

    pub fn post(&self, path: &str, body: &Value) -> Answer {
        self.post_bytes(path, body.to_string().as_bytes())
    }

    /// A POST that must succeed: its JSON.
    pub fn done(&self, path: &str, body: &Value) -> Value {
        let answer = self.post(path, body);
        assert_eq!(answer.status, 200, "{path} {body}: {}", answer.text());
        answer.json()
    }

    pub fn state(&self) -> Value {
        let answer = self.get("/api/state");
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.json()
    }

    /// Uploads a file; its id.
    pub fn upload(&self, name: &str, bytes: &[u8]) -> String {
        let answer = self.post_bytes(&format!("/api/clips?name={name}"), bytes);
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    /// Waits until a state of the studio is so.
    pub fn wait(&self, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let state = self.state();
            if is_so(&state) {
                return state;
            }
            assert!(begun.elapsed() < Duration::from_secs(240), "waited for {what}: {state:#}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits until a clip was read.
    pub fn wait_clip(&self, id: &str) -> Value {
        let of =
            |state: &Value| state["clips"].as_array().unwrap().iter().find(|clip| clip["id"] == id).cloned().unwrap();
        of(&self.wait("a clip", |state| of(state)["state"] != "reading"))
    }

    /// Waits until a job has ended.
    pub fn wait_job(&self, id: &str) -> Value {
        let of = |state: &Value| state["jobs"].as_array().unwrap().iter().find(|job| job["id"] == id).cloned().unwrap();
        of(&self.wait("a job", |state| !["waiting", "running"].contains(&of(state)["state"].as_str().unwrap())))
    }

    /// Listens to the events after `last`, if any.
    pub fn events(&self, last: Option<u64>) -> Events {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let last = last.map(|id| format!("Last-Event-ID: {id}\r\n")).unwrap_or_default();
        stream.write_all(format!("{}{last}\r\n", self.head("GET", "/api/events")).as_bytes()).unwrap();
        let mut from = BufReader::new(stream);
        let mut line = String::new();
        from.read_line(&mut line).unwrap();
        assert!(line.contains(" 200 "), "{line}");
        let headers = headers(&mut from).unwrap();
        Events { from, text: String::new(), headers }
    }
}

/// The port and the token of a redirect file.
pub fn token(file: &std::path::Path) -> (u16, String) {
    let page = std::fs::read_to_string(file).unwrap();
    let address = page.split("url=http://127.0.0.1:").nth(1).unwrap();
    let (port, rest) = address.split_once("/enter?token=").unwrap();
    (port.parse().unwrap(), rest[..32].to_owned())
}

/// A stream of events.
pub struct Events {
    from: BufReader<TcpStream>,
    text: String,
    pub headers: Vec<(String, String)>,
}

/// An event.
#[derive(Debug)]
pub struct Event {
    pub id: u64,
    pub name: String,
    pub data: Value,
}

impl Events {
    pub fn next(&mut self) -> Event {
        loop {
            while let Some((block, rest)) = self.text.split_once("\n\n") {
                let (block, rest) = (block.to_owned(), rest.to_owned());
                self.text = rest;
                let field = |name: &str| block.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
                if let (Some(id), Some(name), Some(data)) = (field("id:"), field("event:"), field("data:")) {
                    let data = serde_json::from_str(data).unwrap();
                    return Event { id: id.parse().unwrap(), name: name.into(), data };
                }
            }
            let chunk = chunk(&mut self.from).expect("the stream goes on");
            self.text.push_str(&String::from_utf8(chunk).unwrap());
        }
    }

    /// The next event of a name.
    pub fn named(&mut self, name: &str) -> Event {
        loop {
            let event = self.next();
            if event.name == name {
                return event;
            }
        }
    }
}
