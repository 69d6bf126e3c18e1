//! A page with music in a real browser: after a jump to 600 s and 20 s of play, dance and music are at one time; what a
//! dancer hits of the beats is lit, what it misses isn't.

use super::browser;
use kinelm::evaluate::dance::beats::BeatPair;
use kinelm::view::music::Music;
use kinelm::view::{Figure, Page};
use kinelm_motion::metric::beat::BeatHits;
use kinelm_motion::synth;
use kinelm_music::wav;
use serde_json::Value;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

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

/// What the page shows at each beat of the music: the light of each dancer, the pulse, and whether it is a ring; and of the
/// whole, how many ticks are lit for each number of dancers, and the captions.
const LIT: &str = "
window.addEventListener('load', () => {
  play(false);
  const lights = [...document.querySelectorAll('.label .light')], pulse = $('pulse');
  const out = player.beats.map(beat => {
    player.show(beat + 0.001);
    return [lights.map(light => Number(light.style.opacity) > 0.9), pulse.style.opacity > 0.9, pulse.classList.contains('missed')];
  });
  const ticks = [...$('ticks').children].map(tick => tick.classList.contains('hit') ? tick.style.background.split('figure').length : 0);
  const says = [...document.querySelectorAll('.label .light')].map(light => light.parentElement.textContent);
  fetch('http://127.0.0.1:PORT/', { method: 'POST', mode: 'no-cors', body: JSON.stringify([out, ticks, [says]]) });
});
";

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
        // what is told ends with its lists
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
fn probed(page: &str, probe: &str, port: u16) -> String {
    let end = page.rfind("</script>").unwrap();
    let (before, behind) = page.split_at(end);
    let open = before.replacen("img-src data:", &format!("img-src data:; connect-src http://127.0.0.1:{port}"), 1);
    open + &probe.replace("PORT", &port.to_string()) + behind
}

/// What a page tells with a probe in it.
fn told(browser: &Path, page: &str, probe: &str) -> Vec<Value> {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("page.html");
    std::fs::write(&path, probed(page, probe, listener.local_addr().unwrap().port())).unwrap();
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
    serde_json::from_str(&told.expect("the page told nothing within two minutes")).unwrap()
}

#[test]
fn what_a_dancer_hits_is_lit_and_what_it_misses_is_not() {
    let Some(browser) = browser("what_a_dancer_hits_is_lit_and_what_it_misses_is_not") else { return };
    let dances = synth::corpus_at(3, &[100.0, 100.0], 12.0, 60.0).unwrap();
    let body: Vec<usize> = (0..22).collect();
    let sound = kinelm::corpus::music::synth::music(&dances[0], 3, 16_000).unwrap();
    // the dance begins a second behind the music
    let from_s = 1.0;
    let beats_s: Vec<f64> = dances[0].beats_s.iter().map(|beat| beat + from_s).collect();
    let own_s: Vec<f64> = beats_s.iter().map(|beat| beat - from_s).collect();
    let hits = dances.iter().map(|dance| BeatPair::new(&dance.clip, &body, &own_s).unwrap().hits(Some(0.17)));
    let hits: Vec<BeatHits> = hits.collect();
    let wav = wav::bytes(&[vec![0.0; 16_000], sound].concat(), 16_000);
    let early = [&[0.25, 0.75], &beats_s[..]].concat();
    let music = Music::embedded(Path::new("song.wav"), &wav, from_s, early);
    let figures = dances.iter().zip(&hits).map(|(dance, hits)| {
        // the music has two beats before the dance
        let each = [&[None, None], &hits.each[..]].concat();
        Figure::new(dance.name(), &dance.clip).hits(Some(BeatHits { each, ..hits.clone() }))
    });
    let figures: Vec<Figure> = figures.collect();
    let page = Page::new(&figures).music(Some(&music)).html().unwrap();
    // to be looked at
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("view-hits.html"), &page).unwrap();
    let told = told(&browser, &page, LIT);
    let hit = |i: usize| [0, 1].map(|n| hits[n].each[i] == Some(true));
    let (at, ticks) = (told[0].as_array().unwrap(), told[1].as_array().unwrap());
    assert!(at.len() > 15 && at.len() == ticks.len(), "{told:?}");
    for (i, found) in at.iter().enumerate() {
        let [a, b] = hit(i);
        assert_eq!(*found, serde_json::json!([[a, b], true, !a && !b]), "beat {i}: {told:?}");
        let colours = [a, b].into_iter().filter(|hit| *hit).count();
        // each dancer's colour stands there, and the last once more to end the stripes
        assert_eq!(
            ticks[i].as_u64().unwrap() as usize,
            if colours > 0 { colours + 2 } else { 0 },
            "beat {i}: {told:?}"
        );
    }
    for (says, hits) in told[2][0].as_array().unwrap().iter().zip(&hits) {
        let expected = format!("{} of {} beats hit, by chance {:.0}", hits.hit(), hits.beats(), hits.chance);
        assert_eq!(says, &expected);
    }
    // the one whose music it is keeps to it
    assert!(hits[0].hit() as f64 > 1.5 * hits[0].chance && hits[0].hit() < hits[0].beats(), "{hits:?}");
    let unlike = [figures[0].clone().hits(Some(BeatHits::default()))];
    let said = Page::new(&unlike).music(Some(&music)).html().unwrap_err().to_string();
    assert!(said.contains("0 marks of hits for ") && said.contains("beats of music; expected as many"), "{said}");
}

#[test]
fn dance_and_music_keep_together() {
    let Some(browser) = browser("dance_and_music_keep_together") else { return };
    let clip = synth::corpus(1, 1, 640.0, 2.0).unwrap().remove(0).clip;
    let beats: Vec<f64> = (0..1280).map(|i| 0.5 * f64::from(i)).collect();
    let tick = |i: u32| if i % 4000 < 80 { 0.5 } else { 0.0 };
    let sound: Vec<f32> = (0..650 * 8000).map(tick).collect();
    let music = Music::embedded(Path::new("ticks.wav"), &wav::bytes(&sound, 8000), 2.5, beats);
    let page = Page::new(&[Figure::new("ticks", &clip)]).music(Some(&music)).html().unwrap();
    let told = told(&browser, &page, PROBE);
    let number = |row: &Value, i: usize| row[i].as_f64().unwrap();
    // a second after the jump everything has got there
    let after: Vec<&Value> = told.iter().filter(|row| number(row, 0) > 2.0).collect();
    let mut apart: Vec<f64> = after.iter().map(|row| (number(row, 1) - number(row, 2)).abs()).collect();
    apart.sort_by(f64::total_cmp);
    // the page may have to wait between its looks at the two clocks: that is no drift, and rare
    let worst = apart[apart.len() * 19 / 20];
    println!("{} looks, 19 of 20 at most {:.1} ms apart", after.len(), 1e3 * worst);
    assert!(after.len() > 60 && after.iter().all(|row| row[3] == false), "{after:?}");
    assert!(worst < DRIFT_S, "{worst} s apart: {after:?}");
    let [first, last] = [after[0], after[after.len() - 1]];
    assert!(number(first, 1) > 600.0 && number(last, 1) > 619.0, "from {first} to {last}");
}
