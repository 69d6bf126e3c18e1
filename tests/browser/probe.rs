//! Pages as a browser has them.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Drawing by software on a busy machine takes its time.
const PATIENCE: Duration = Duration::from_secs(180);

/// The page's elements after its script has run, at a fragment of its address.
pub fn opened(browser: &Path, page: &Path, fragment: &str) -> String {
    opened_with(browser, &["--use-angle=swiftshader", "--enable-unsafe-swiftshader"], page, fragment)
}

pub fn opened_with(browser: &Path, drawing: &[&str], page: &Path, fragment: &str) -> String {
    let profile = tempfile::tempdir().unwrap();
    let dom = profile.path().join("dom.html");
    let mut child = Command::new(browser)
        .args(["--headless", "--no-sandbox"])
        .args(drawing)
        .args(["--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"])
        .args(["--disable-sync", "--disable-extensions", "--window-size=800,450", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().join("profile").display()))
        .arg(format!("file://{}#{fragment}", page.display()))
        .stdout(std::fs::File::create(&dom).unwrap())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begin = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begin.elapsed() > PATIENCE {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("the browser was not done after {PATIENCE:?}");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    std::fs::read_to_string(dom).unwrap()
}

/// What a script at the end of a page passes to `answer`.
pub fn answers(browser: &Path, page: &str, script: &str) -> Value {
    let (before, behind) = page.split_at(page.rfind("</script>").unwrap());
    let answer = "const answer = value => document.body.append(Object.assign(document.createElement('pre'), \
                  { id: 'answer', textContent: encodeURIComponent(JSON.stringify(value)) }));";
    let probe = format!("{answer}\ntry {{ {script} }} catch (e) {{ answer(String(e.stack)); }}\n");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("page.html");
    std::fs::write(&path, [before, &probe, behind].concat()).unwrap();
    let dom = opened(browser, &path, "pause&light");
    let (_, after) = dom.split_once("<pre id=\"answer\">").unwrap_or_else(|| panic!("no answer in {dom}"));
    let coded = after.split("</pre>").next().unwrap();
    let mut bytes = Vec::new();
    let mut rest = coded.bytes();
    while let Some(byte) = rest.next() {
        let mut digit = || char::from(rest.next().unwrap()).to_digit(16).unwrap() as u8;
        bytes.push(if byte == b'%' { 16 * digit() + digit() } else { byte });
    }
    serde_json::from_slice(&bytes).unwrap()
}
