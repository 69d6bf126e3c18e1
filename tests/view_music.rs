//! A page with music in a real browser: after a jump to 600 s and 20 s of play, dance and music are at one time.

use kinelm::view::music::Music;
use kinelm::view::{Figure, page_with};
use kinelm_motion::synth;
use kinelm_music::wav;
use serde_json::Value;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const BROWSERS: [&str; 5] =
    ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
/// How far apart they may be, seconds.
const DRIFT_S: f64 = 0.02;

/// What the page tells of itself, every quarter of a second: its own clock, the dance's time, the music's.
const PROBE: &str = "
window.addEventListener('load', () => {
  const out = [], begin = performance.now();
  setTimeout(() => { play(true); seek(600); }, 1000);
  // asked in the callback of a picture, as between two of them the dance's time is the last one's
  const id = setInterval(() => requestAnimationFrame(() => {
    const a = player.audio, at = performance.now() - begin;
    out.push([at / 1000, state.time, a.currentTime - player.from, a.paused]);
    if (at < 22500) return;
    clearInterval(id);
    fetch('http://127.0.0.1:PORT/', { method: 'POST', mode: 'no-cors', body: JSON.stringify(out) });
  }), 250);
});
";

fn browser() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let mut all = BROWSERS.iter().flat_map(|name| std::env::split_paths(&path).map(move |folder| folder.join(name)));
    let found = all.find(|p| p.is_file());
    if found.is_none() {
        kinelm_shared_data::skipped("dance_and_music_keep_together", "no chromium on the PATH");
    }
    found
}

/// The body of the first request within a time.
fn posted(listener: &TcpListener, within: Duration) -> Option<String> {
    listener.set_nonblocking(true).unwrap();
    let begin = Instant::now();
    while begin.elapsed() < within {
        let Ok((mut stream, _)) = listener.accept() else {
            std::thread::sleep(Duration::from_millis(50));
            continue;
        };
        stream.set_nonblocking(false).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let (mut text, mut piece) = (Vec::new(), [0; 4096]);
        // the numbers end with their list
        while !text.ends_with(b"]]") {
            match stream.read(&mut piece) {
                Ok(n) if n > 0 => text.extend(&piece[..n]),
                _ => break,
            }
        }
        let _ = stream.write_all(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n");
        let text = String::from_utf8_lossy(&text).into_owned();
        return text.split_once("\r\n\r\n").map(|(_, body)| body.to_owned());
    }
    None
}

/// The page with the probe, which may call nobody but this test.
fn probed(page: &str, port: u16) -> String {
    let end = page.rfind("</script>").unwrap();
    let (before, behind) = page.split_at(end);
    let open = before.replacen("img-src data:", &format!("img-src data:; connect-src http://127.0.0.1:{port}"), 1);
    open + &PROBE.replace("PORT", &port.to_string()) + behind
}

#[test]
fn dance_and_music_keep_together() {
    let Some(browser) = browser() else { return };
    let clip = synth::corpus(1, 1, 640.0, 2.0).unwrap().remove(0).clip;
    let beats: Vec<f64> = (0..1280).map(|i| 0.5 * f64::from(i)).collect();
    let tick = |i: u32| if i % 4000 < 80 { 0.5 } else { 0.0 };
    let sound: Vec<f32> = (0..650 * 8000).map(tick).collect();
    let music = Music::embedded(Path::new("ticks.wav"), &wav::bytes(&sound, 8000), 2.5, beats);
    let page = page_with(&[Figure::new("ticks", &clip)], Some(&music)).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("page.html");
    std::fs::write(&path, probed(&page, listener.local_addr().unwrap().port())).unwrap();
    let mut child = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        .args(["--autoplay-policy=no-user-gesture-required", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .args(["--window-size=300,200", "--remote-debugging-port=0"])
        .arg(format!("--user-data-dir={}", dir.path().join("profile").display()))
        .arg(format!("file://{}", path.display()))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let told = posted(&listener, Duration::from_secs(120));
    child.kill().unwrap();
    child.wait().unwrap();
    let told: Vec<Value> = serde_json::from_str(&told.expect("the page told nothing within two minutes")).unwrap();
    let number = |row: &Value, i: usize| row[i].as_f64().unwrap();
    // a second after the jump everything has got there
    let after: Vec<&Value> = told.iter().filter(|row| number(row, 0) > 2.0).collect();
    let worst = after.iter().map(|row| (number(row, 1) - number(row, 2)).abs()).fold(0.0, f64::max);
    println!("{} looks, at most {:.1} ms apart", after.len(), 1e3 * worst);
    assert!(after.len() > 60 && after.iter().all(|row| row[3] == false), "{after:?}");
    assert!(worst < DRIFT_S, "{worst} s apart: {after:?}");
    let [first, last] = [after[0], after[after.len() - 1]];
    assert!(number(first, 1) > 600.0 && number(last, 1) > 619.0, "from {first} to {last}");
}
