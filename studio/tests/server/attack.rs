//! Every rule of docs/studio.md, "Threats", attacked.

use super::client::{Answer, Browser, send, token};
use super::place::Place;
use serde_json::json;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::path::Path;
use std::time::{Duration, Instant};

/// Every route, with its method.
const ROUTES: [(&str, &str); 28] = [
    ("GET", "/"),
    ("GET", "/assets/index.html"),
    ("GET", "/api/state"),
    ("GET", "/api/events"),
    ("GET", "/api/frames?since=0"),
    ("POST", "/api/clips?name=a.bvh"),
    ("POST", "/api/maps?name=a.toml"),
    ("GET", "/api/clips/c1/figure"),
    ("GET", "/api/clips/c1/sound"),
    ("POST", "/api/clips/c1/reading"),
    ("POST", "/api/clips/c1/remove"),
    ("POST", "/api/clips/c1/rename"),
    ("POST", "/api/search"),
    ("POST", "/api/compare"),
    ("GET", "/api/compare/c1/c2"),
    ("POST", "/api/music"),
    ("GET", "/api/timeline"),
    ("POST", "/api/timeline"),
    ("POST", "/api/undo"),
    ("POST", "/api/redo"),
    ("POST", "/api/make"),
    ("POST", "/api/jobs/j1/cancel"),
    ("GET", "/api/dances/d1/figure"),
    ("POST", "/api/dances/d1/keep"),
    ("POST", "/api/dances/d1/reject"),
    ("GET", "/api/dances/d1/export?format=bvh"),
    ("POST", "/api/stop"),
    ("GET", "/api/none"),
];

fn raw(port: u16, method: &str, path: &str, headers: &str) -> Answer {
    let request = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n{headers}Content-Length: 0\r\n\r\n");
    send(port, request.as_bytes()).unwrap_or_else(|| panic!("{method} {path} {headers:?}: no answer"))
}

/// Whether an answer gives nothing away.
fn is_refused(answer: &Answer) -> bool {
    let is_bounce = answer.status == 200 && answer.text().contains("url=/?in") && answer.body.len() < 300;
    answer.status == 403 || is_bounce
}

#[test]
fn nothing_answers_beyond_loopback() {
    let place = Place::new();
    // the address of this machine on a network, if it has one; no packet is sent for it
    let socket = UdpSocket::bind("0.0.0.0:0").unwrap();
    let own = socket.connect("192.0.2.1:9").and_then(|()| socket.local_addr());
    if let Ok(SocketAddr::V4(own)) = own
        && !own.ip().is_loopback()
    {
        let there = SocketAddr::from((*own.ip(), place.browser.port));
        assert!(TcpStream::connect_timeout(&there, Duration::from_secs(2)).is_err(), "{there}");
    }
    assert_eq!(place.browser.get("/api/state").status, 200);
}

#[test]
fn the_token_is_the_users_alone_and_opens_once() {
    let place = Place::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(place.file()).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        // nor is it in the list of processes
        let line = std::fs::read("/proc/self/cmdline").unwrap_or_default();
        assert!(!String::from_utf8_lossy(&line).contains(&token(&place.file()).1));
    }
    let (port, first) = token(&place.file());
    let host = format!("Host: 127.0.0.1:{port}\r\n");
    for wrong in ["", "?token=", "?token=0", &format!("?token={}", "0".repeat(32)), &format!("?token={first}0"), "?a=b"]
    {
        assert_eq!(raw(port, "GET", &format!("/enter{wrong}"), &host).status, 403, "{wrong}");
    }
    let entered = raw(port, "GET", &format!("/enter?token={first}"), &host);
    let cookie = entered.header("set-cookie").unwrap();
    assert_eq!((entered.status, entered.header("location")), (303, Some("/")));
    for part in ["HttpOnly", "SameSite=Strict", "Path=/"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    assert_eq!(raw(port, "GET", &format!("/enter?token={first}"), &host).status, 403);
    let next = token(&place.file()).1;
    assert!(next != first, "the file has the next one");
    assert_eq!(raw(port, "GET", &format!("/enter?token={next}"), "Host: evil.example\r\n").status, 403);
    Browser::enter(&place.file());
}

#[test]
fn without_a_cookie_nothing_is_given_away() {
    let place = Place::new();
    let port = place.browser.port;
    let own = format!("Host: 127.0.0.1:{port}\r\nSec-Fetch-Site: same-origin\r\n");
    let name = place.browser.cookie.split('=').next().unwrap();
    let cookies = ["".to_owned(), format!("Cookie: {name}={}\r\n", "0".repeat(32)), format!("Cookie: {name}=\r\n")];
    for (method, path) in ROUTES {
        for cookie in &cookies {
            let answer = raw(port, method, path, &format!("{own}{cookie}"));
            assert!(is_refused(&answer), "{method} {path} {cookie}: {answer:?}");
        }
    }
}

#[test]
fn a_name_that_is_pointed_at_us_is_refused() {
    let place = Place::new();
    let (port, cookie) = (place.browser.port, &place.browser.cookie);
    for host in
        ["evil.example", &format!("evil.example:{port}"), "127.0.0.1", "127.0.0.1:1", "localhost.evil.example", ""]
    {
        for (method, path) in ROUTES {
            let headers = format!("Host: {host}\r\nCookie: {cookie}\r\nSec-Fetch-Site: same-origin\r\n");
            assert_eq!(raw(port, method, path, &headers).status, 403, "{host} {method} {path}");
        }
    }
    for host in [format!("127.0.0.1:{port}"), format!("localhost:{port}"), format!("[::1]:{port}")] {
        let headers = format!("Host: {host}\r\nCookie: {cookie}\r\nSec-Fetch-Site: same-origin\r\n");
        assert_eq!(raw(port, "GET", "/api/state", &headers).status, 200, "{host}");
    }
}

#[test]
fn another_page_with_the_cookie_is_refused() {
    let place = Place::new();
    let (port, cookie) = (place.browser.port, &place.browser.cookie);
    let own = format!("Host: 127.0.0.1:{port}\r\nCookie: {cookie}\r\n");
    let foreign = [
        "Sec-Fetch-Site: cross-site\r\n",
        // a server on another port of this machine: cookies know no ports
        "Sec-Fetch-Site: same-site\r\n",
        "Sec-Fetch-Site: none\r\n",
        "Sec-Fetch-Site: same-origin\r\nOrigin: http://evil.example\r\n",
        "Sec-Fetch-Site: same-origin\r\nOrigin: null\r\n",
        "Origin: http://127.0.0.1:1\r\n",
        "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: navigate\r\nSec-Fetch-Dest: document\r\n",
        "",
    ];
    for (method, path) in ROUTES {
        for headers in foreign {
            let answer = raw(port, method, path, &format!("{own}{headers}"));
            assert!(is_refused(&answer), "{method} {path} {headers:?}: {answer:?}");
        }
    }
    // a picture, a script, a frame of another page
    for dest in ["image", "script", "iframe", "object"] {
        let headers =
            format!("{own}Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: no-cors\r\nSec-Fetch-Dest: {dest}\r\n");
        assert!(is_refused(&raw(port, "GET", "/", &headers)));
        assert_eq!(raw(port, "GET", "/?in", &headers).status, 403);
    }
    // typed by the user it opens, and its own requests pass
    let typed = "Sec-Fetch-Site: none\r\nSec-Fetch-Mode: navigate\r\nSec-Fetch-Dest: document\r\n";
    let page = raw(port, "GET", "/", &format!("{own}{typed}"));
    assert!(page.status == 200 && page.text().contains("<html"), "{page:?}");
    let origin = format!("{own}Origin: http://127.0.0.1:{port}\r\n");
    assert_eq!(raw(port, "POST", "/api/search", &origin).status, 400);
}

#[test]
fn every_answer_carries_the_headers() {
    let place = Place::new();
    let (browser, port) = (&place.browser, place.browser.port);
    let asset = browser.get("/assets/index.html");
    let tag = asset.header("etag").unwrap().to_owned();
    let again = format!("{}If-None-Match: {tag}\r\n\r\n", browser.head("GET", "/assets/index.html"));
    let answers = [
        ("page", browser.get("/")),
        ("asset", asset),
        ("not modified", send(port, again.as_bytes()).unwrap()),
        ("state", browser.get("/api/state")),
        ("unknown", browser.get("/api/none")),
        ("wrong method", browser.get("/api/make")),
        ("wrong body", browser.post_bytes("/api/make", b"{")),
        ("refused", raw(port, "GET", "/api/state", "Host: evil.example\r\n")),
        ("bounced", raw(port, "GET", "/", &format!("Host: 127.0.0.1:{port}\r\n"))),
        (
            "entered",
            raw(
                port,
                "GET",
                &format!("/enter?token={}", token(&place.file()).1),
                &format!("Host: 127.0.0.1:{port}\r\n"),
            ),
        ),
    ];
    let statuses = [200, 200, 304, 200, 404, 405, 400, 403, 200, 303];
    let check = |what: &str, header: &dyn Fn(&str) -> Option<String>| {
        let policy = header("content-security-policy").unwrap_or_else(|| panic!("{what}"));
        for part in ["default-src 'none'", "script-src 'self'", "frame-ancestors 'none'", "form-action 'none'"] {
            assert!(policy.contains(part) && !policy.contains("unsafe"), "{what}: {policy}");
        }
        for (name, value) in [
            ("cross-origin-resource-policy", "same-origin"),
            ("cross-origin-opener-policy", "same-origin"),
            ("referrer-policy", "no-referrer"),
            ("x-content-type-options", "nosniff"),
            ("x-frame-options", "DENY"),
        ] {
            assert_eq!(header(name).as_deref(), Some(value), "{what}");
        }
        assert_eq!(header("access-control-allow-origin"), None, "{what}");
    };
    for ((what, answer), status) in answers.iter().zip(statuses) {
        assert_eq!(answer.status, status, "{what}: {answer:?}");
        check(what, &|name| answer.header(name).map(str::to_owned));
        let stored = answer.header("cache-control");
        let is_asset = ["page", "asset", "not modified"].contains(what);
        assert_eq!(stored, Some(if is_asset { "no-cache" } else { "no-store" }), "{what}");
    }
    let events = browser.events(None);
    check("events", &|name| events.headers.iter().find(|(own, _)| own == name).map(|(_, value)| value.clone()));
}

#[test]
fn names_lead_to_no_other_file() {
    let place = Place::new();
    std::fs::write(place.project().join("secret.txt"), "secret").unwrap();
    for path in [
        "/assets/../Cargo.toml",
        "/assets/..%2f..%2fetc%2fpasswd",
        "/assets/%2e%2e%2fsecret.txt",
        "/assets/..\\secret.txt",
        "/assets//etc/passwd",
        "/assets/%00",
        "/assets/",
        "/api/clips/..%2f..%2fsecret.txt/figure",
        "/api/clips/%2fetc%2fpasswd/sound",
        "/api/dances/..%2fsecret/export?format=bvh",
        "/api/dances/d1/export?format=../../secret.txt",
    ] {
        let answer = place.browser.get(path);
        assert!([400, 404].contains(&answer.status), "{path}: {answer:?}");
        assert!(
            !answer.text().contains("root:") && !answer.text().contains("secret.txt\""),
            "{path}: {}",
            answer.text()
        );
    }
    let folder = place.project().display().to_string();
    let id = place.browser.upload("..%2F..%2F..%2Fevil.bvh", b"HIERARCHY of nothing");
    let clip = place.browser.wait_clip(&id);
    assert!(place.project().join("clips/evil.bvh").exists() && clip["state"] == "failed");
    let error = clip["error"].as_str().unwrap();
    assert!(error.contains("evil.bvh") && !error.contains(&folder) && !error.contains("/tmp"), "{error}");
    // not even by a map of the library, which may be a file
    for map in ["/etc/passwd", "maps/../secret.toml", "maps/none.toml", "timeline.toml"] {
        let map = place.browser.post(&format!("/api/clips/{id}/reading"), &json!({ "map": map }));
        assert!(map.status == 400 && map.error().contains("built-in"), "{map:?}");
    }
    let map = place.browser.post_bytes("/api/maps?name=..%2F..%2Fmine.toml", b"name = 1\n");
    assert!(map.status == 422 && !place.project().join("maps/mine.toml").exists(), "{map:?}");
    let text = kinelm_motion::rig::SkeletonMap::builtin("smpl").unwrap().to_toml();
    let map = place.browser.post_bytes("/api/maps?name=..%2F..%2Fmine.toml", text.as_bytes());
    assert_eq!((map.status, &map.json()["map"]), (200, &json!("maps/mine.toml")));
    assert!(place.project().join("maps/mine.toml").exists());
}

#[test]
fn a_timelines_text_reads_no_other_file() {
    let place = Place::new();
    let outside = place.dir.path().join("outside.bvh");
    std::fs::write(&outside, super::place::bytes("a.bvh", &super::place::dance(1, 3.0, 60.0))).unwrap();
    std::fs::copy(&outside, place.project().join("clips/beside.bvh")).unwrap();
    for file in [outside.to_str().unwrap(), "../outside.bvh", "clips/beside.bvh", "/etc/passwd", "/etc/none"] {
        let text = format!("rig = \"a\"\n[clips.a]\nfile = \"{file}\"\n[[segment]]\nclip = \"a\"\nfrom = 0\nto = 1\n");
        let view = place.browser.done("/api/timeline", &json!({ "edits": [{ "op": "text", "text": text }] }));
        let trouble = view["trouble"][0]["text"].as_str().unwrap();
        assert!(trouble.contains("a clip of the library") && !trouble.contains("root:"), "{file}: {trouble}");
    }
    let id = place.browser.upload("mine.bvh", &std::fs::read(&outside).unwrap());
    place.browser.wait_clip(&id);
    let text = "rig = \"a\"\n[clips.a]\nfile = \"clips/mine.bvh\"\nmap = \"MAP\"\n[[segment]]\nclip = \"a\"\nfrom = 0\nto = 1\n";
    let with = |map: &str| {
        let edits = json!({ "edits": [{ "op": "text", "text": text.replace("MAP", map) }] });
        place.browser.done("/api/timeline", &edits)["trouble"].to_string()
    };
    for map in ["/etc/passwd", "maps/../secret.toml", "../mine.toml", "maps/none.toml"] {
        assert!(with(map).contains("that is built in"), "{map}: {}", with(map));
    }
    assert!(!with("smpl").contains("that is built in"));
}

#[test]
fn a_project_of_somebody_else_leads_to_no_other_file() {
    let place = Place::new();
    let (project, outside) = (place.project(), place.dir.path().join("outside"));
    std::fs::write(&outside, "mine").unwrap();
    let journal = project.join(".studio/journal.jsonl");
    let dir = place.stop();
    let opens = || kinelm_studio::Server::open(&super::place::options(&project), &kinelm_studio::Listen::default());
    let refused = |what: &str| {
        let said = opens().err().map(|e| e.to_string()).unwrap_or_default();
        assert!(said.contains(what), "{said}");
        assert_eq!(std::fs::read_to_string(&outside).unwrap(), "mine");
    };
    let good = std::fs::read_to_string(&journal).unwrap();
    for (id, made, kept) in [
        ("../../d1", "null", "null"),
        ("d1", "\"../../outside\"", "null"),
        ("d1", "\".studio/made/d1.bvh\"", "\"../../outside\""),
        ("d1", "\".studio/made/d1.bvh\"", "\"dances/evil.desktop\""),
    ] {
        let line = format!(
            "{{\"plain\":[{{\"dance\":{{\"before\":null,\"after\":{{\"id\":\"{id}\",\"name\":\"a\",\"made\":{made},\"kept\":{kept},\
             \"variation\":1,\"seed\":1,\"frames\":1,\"fps\":20}}}}}}]}}"
        );
        // checksums go on from line to line
        let last = good.lines().last().and_then(|line| u32::from_str_radix(line.get(11..19)?, 16).ok()).unwrap_or(0);
        let checksum = crc32c::crc32c_append(last, line.as_bytes());
        let dance = format!("{{\"crc32c\":\"{checksum:08x}\",\"line\":{line}}}\n");
        std::fs::write(&journal, format!("{good}{dance}")).unwrap();
        refused("an id or a file that a studio wouldn't write");
    }
    std::fs::write(&journal, &good).unwrap();
    #[cfg(unix)]
    {
        let in_its_place = |name: &str, put: &dyn Fn(&Path)| {
            let (path, kept) = (project.join(name), project.join("kept"));
            let was = path.exists();
            if was {
                std::fs::rename(&path, &kept).unwrap();
            }
            put(&path);
            refused(name);
            std::fs::remove_file(&path).unwrap();
            if was {
                std::fs::rename(&kept, &path).unwrap();
            }
        };
        let link = |path: &Path| std::os::unix::fs::symlink(&outside, path).unwrap();
        let written =
            [".studio/lock", ".studio/journal.jsonl", ".studio/jobs.jsonl", ".studio/open.html", "timeline.toml"];
        let folders = [".studio/made", ".studio/cache", "dances", "clips", "converted"];
        for name in written.into_iter().chain(folders).chain([".studio/cache/c1.json", "clips/deep.bvh"]) {
            in_its_place(name, &link);
        }
        // what would be waited for without an end
        let pipe = |path: &Path| assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
        for name in &written[..3] {
            in_its_place(name, &pipe);
        }
        // all at once, with the way out
        for name in ["a", "b"] {
            link(&project.join("clips").join(name));
        }
        refused("2 links: clips/a, clips/b");
        refused("`kinelm studio FILE`");
        for name in ["a", "b"] {
            std::fs::remove_file(project.join("clips").join(name)).unwrap();
        }
    }
    assert!(opens().is_ok());
    drop(dir);
}

#[test]
fn cookies_of_other_servers_lock_nobody_out() {
    let place = Place::new();
    let head = place.browser.head("GET", "/api/state").replace("Cookie: ", "Cookie: lang=D\u{e4}nish; ");
    assert_eq!(super::client::send(place.browser.port, format!("{head}\r\n").as_bytes()).unwrap().status, 200);
}

#[test]
fn errors_name_no_folders() {
    let place = Place::new();
    let folder = place.project().display().to_string();
    let text = format!(
        "rig = \"a\"\n[clips.a]\nfile = \"{folder}/clips/gone.bvh\"\n[[segment]]\nclip = \"a\"\nfrom = 0\nto = 1\n"
    );
    let view = place.browser.done("/api/timeline", &json!({ "edits": [{ "op": "text", "text": text }] }));
    let trouble = view["trouble"][0]["text"].as_str().unwrap();
    assert!(trouble.contains("gone.bvh") && !trouble.contains(&folder), "{trouble}");
    let job = place.browser.done("/api/make", &json!({ "kind": "timeline" }))["job"].as_str().unwrap().to_owned();
    let job = place.browser.wait_job(&job);
    assert!(job["state"] == "failed" && !job["text"].as_str().unwrap().contains(&folder), "{job}");
    assert!(!place.browser.get("/api/state").text().contains(&folder));
}

#[test]
fn bodies_have_limits() {
    let place = Place::new();
    let large = vec![b' '; (1 << 20) + 1];
    assert_eq!(place.browser.post_bytes("/api/make", &large).status, 413);
    let head =
        format!("{}Content-Length: {}\r\n\r\n", place.browser.head("POST", "/api/clips?name=a.bvh"), 600u64 << 20);
    let answer = send(place.browser.port, head.as_bytes()).unwrap();
    assert!(answer.status == 413 && answer.error().contains("512 MB"), "{answer:?}");
    let deep = format!("{}{}", "[".repeat(200_000), "]".repeat(200_000));
    assert_eq!(place.browser.post_bytes("/api/timeline", deep.as_bytes()).status, 400);
    let head = format!("{}X: {}\r\n\r\n", place.browser.head("GET", "/api/state"), "x".repeat(200 << 10));
    assert!(send(place.browser.port, head.as_bytes()).is_none_or(|answer| answer.status == 431));
    assert_eq!(place.browser.get("/api/state").status, 200);
}

#[test]
fn slow_heads_end_and_make_room() {
    let place = Place::new();
    let port = place.browser.port;
    let begun = Instant::now();
    let slow: Vec<TcpStream> = (0..300)
        .map(|_| {
            let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
            stream.write_all(b"GET / HTTP/1.1\r\nHost: ").unwrap();
            stream
        })
        .collect();
    assert_eq!(place.browser.get("/api/state").status, 200, "after the first ones were ended");
    assert!(begun.elapsed() < Duration::from_secs(40), "{:?}", begun.elapsed());
    let mut first = &slow[0];
    first.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let mut rest = Vec::new();
    let _ = first.read_to_end(&mut rest);
    assert!(!String::from_utf8_lossy(&rest).contains(" 200 "));
}
