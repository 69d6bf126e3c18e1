//! `kinelm studio` as a user starts it.

use super::support::{kinelm_in, save};
use kinelm_motion::synth;
use predicates::prelude::*;
use predicates::str::contains;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A studio, which ends with the test.
struct Studio {
    child: Child,
    line: String,
    port: u16,
    cookie: String,
}

impl Drop for Studio {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Starts it in a folder and goes in by the file that it names.
fn studio(folder: &Path, words: &str) -> Studio {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kinelm"));
    command
        .current_dir(folder)
        .env("XDG_CACHE_HOME", folder.join("cache"))
        .stdout(Stdio::piped())
        .stderr(Stdio::null());
    command.args(["studio", "--no-open", "--empty"]).args(words.split_whitespace());
    let mut child = command.spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let file = PathBuf::from(line.trim().strip_prefix("kinelm studio: open ").unwrap());
    let page = std::fs::read_to_string(file).unwrap();
    let address = page.split("url=http://127.0.0.1:").nth(1).unwrap();
    let (port, rest) = address.split_once('/').unwrap();
    let mut studio = Studio { child, line, port: port.parse().unwrap(), cookie: String::new() };
    let entered = studio.send("GET", &format!("/{}", rest.split('"').next().unwrap()), b"");
    let cookie = entered.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    studio.cookie = cookie.split(';').next().unwrap().to_owned();
    studio
}

impl Studio {
    /// A request of its own page; head and body of the answer.
    fn send(&self, method: &str, path: &str, body: &[u8]) -> String {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let (port, cookie, length) = (self.port, &self.cookie, body.len());
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nCookie: {cookie}\r\nSec-Fetch-Site: same-origin\r\n\
             Connection: close\r\nContent-Length: {length}\r\n\r\n"
        );
        stream.write_all(&[head.as_bytes(), body].concat()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    fn wait(&self, what: &str) -> String {
        let begun = Instant::now();
        loop {
            let state = self.send("GET", "/api/state", b"");
            if state.contains(what) {
                return state;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "waited for {what}: {state}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

#[test]
fn a_studio_opens_reads_files_with_this_program_and_ends() {
    let dir = tempfile::tempdir().unwrap();
    save(&dir.path().join("own/mine.bvh"), &synth::corpus(3, 1, 4.0, 30.0).unwrap()[0].clip);
    let mut studio = studio(dir.path(), "own/mine.bvh");
    assert!(!studio.line.contains("token") && studio.line.contains("kinelm-studio"), "{}", studio.line);
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/motion/tests/golden/blender_dance.fbx");
    let answer = studio.send("POST", "/api/clips?name=dance.fbx", &std::fs::read(golden).unwrap());
    assert!(answer.contains(" 200 "), "{answer}");
    let state = studio.wait("\"format\":\"FBX\"");
    assert!(state.contains("\"name\":\"mine\"") && state.contains("\"name\":\"ready\""), "{state}");
    // nobody else has the project meanwhile
    let other = kinelm_in(dir.path(), "studio --no-open").env("XDG_CACHE_HOME", dir.path().join("cache")).assert();
    other.code(2).stderr(contains("is open in another studio"));
    assert!(studio.send("GET", "/", b"").contains("<html"));
    assert!(studio.send("POST", "/api/stop", b"").contains(" 200 "));
    assert!(studio.child.wait().unwrap().success());
    assert!(!dir.path().join("kinelm-studio/.studio/open.html").exists());
    let text = std::fs::read_to_string(dir.path().join("kinelm-studio/timeline.toml")).unwrap();
    assert!(text.contains("file = \"../own/mine.bvh\""), "{text}");
}

#[test]
fn wrong_calls_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let call = |words: &str| {
        let mut command = kinelm_in(dir.path(), words);
        command.env("XDG_CACHE_HOME", dir.path().join("cache"));
        command.assert()
    };
    call("studio --no-open p none.bvh").failure().stderr(contains("none.bvh"));
    call("studio --no-open --bind 0.0.0.0").code(2).stderr(contains("--bind is 0.0.0.0; expected a name"));
    call("studio --no-open --run nothing").failure().stderr(contains("nothing"));
    call("studio-read").failure().stderr(contains("a job that the studio wrote"));
    call("--help").success().stdout(contains("studio").and(contains("studio-read").not()));
    let busy = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = busy.local_addr().unwrap().port();
    call(&format!("studio --no-open --port {port}")).failure().stderr(contains(format!("127.0.0.1:{port}")));
}
