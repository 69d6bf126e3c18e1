//! A folder with a small model, and servers in it: on a thread of this program, or in a process of their own.

use super::client::Browser;
use kinelm_corpus::Split;
use kinelm_model::ModelConfig;
use kinelm_motion::{Clip, Motion, format, joints, synth};
use kinelm_studio::{Limits, Listen, Options, Reader, Server, Stopper, read_file};
use kinelm_tokenizer::TokenizerConfig;
use kinelm_train::{TrainConfig, fixture};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::thread::JoinHandle;

/// What the process is that reads files: `read`, `hang` or `crash`.
const CHILD: &str = "KINELM_STUDIO_CHILD";
/// The project of a server in a process of its own, and its model.
const SERVER: &str = "KINELM_STUDIO_SERVER";
const RUN: &str = "KINELM_STUDIO_RUN";

/// Not a test of its own: the process that reads files for the others.
#[test]
fn reads_where_it_is_the_child() {
    match std::env::var(CHILD).as_deref() {
        Ok("read") => read_file().unwrap(),
        Ok("hang") => std::thread::sleep(std::time::Duration::from_secs(600)),
        Ok("crash") => std::process::abort(),
        _ => {}
    }
}

/// Not a test of its own: a server that others kill.
#[test]
fn serves_where_it_is_the_server() {
    let (Some(project), Some(run)) = (std::env::var_os(SERVER), std::env::var_os(RUN)) else { return };
    let options = Options { run: Some(run.into()), ..options(Path::new(&project)) };
    let server = Server::open(&options, &Listen::default()).unwrap();
    std::fs::write(Path::new(&project).with_extension("ready"), server.file().to_str().unwrap()).unwrap();
    server.run().unwrap();
}

/// A process that serves a project, which is ended when this is dropped.
pub struct Process(pub std::process::Child, pub Browser);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts a server in a process of its own.
pub fn process(project: &Path) -> Process {
    let ready = project.with_extension("ready");
    let _ = std::fs::remove_file(&ready);
    let mut command = std::process::Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "place::serves_where_it_is_the_server"]).env(SERVER, project).env(RUN, run());
    command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
    let mut child = command.spawn().unwrap();
    let begun = std::time::Instant::now();
    while !ready.exists() {
        assert!(child.try_wait().unwrap().is_none(), "the server ended");
        assert!(begun.elapsed() < std::time::Duration::from_secs(60), "the server begins");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    // written whole before it is read
    std::thread::sleep(std::time::Duration::from_millis(20));
    Process(child, Browser::enter(&project.join(".studio/open.html")))
}

/// A run of a tiny model of 13 joints that was hardly trained, made once by this program.
pub fn run() -> &'static Path {
    static RUN: OnceLock<PathBuf> = OnceLock::new();
    RUN.get_or_init(|| {
        let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("studio-run");
        let _ = std::fs::remove_dir_all(&dir);
        let clips = [(150, Split::Train), (150, Split::Train), (150, Split::Train), (120, Split::Valid)];
        let tokenizer = TokenizerConfig::uniform(&joints::THIRTEEN, 20.0, 40);
        fixture::danced(&dir.join("corpus"), tokenizer, &clips);
        let model = ModelConfig { layers: 1, heads: 1, width: 16, context: 43 * 8, ..ModelConfig::default() };
        let train = TrainConfig { steps: 2, batch: 1, warmup: 1, ..TrainConfig::default() };
        fixture::run(&dir, model, train);
        dir.join("run")
    })
}

/// A reader of files that is this program.
pub fn reader(what: &str) -> Reader {
    let program = std::env::current_exe().unwrap();
    let args = ["--exact", "place::reads_where_it_is_the_child"].map(Into::into).to_vec();
    Reader { program, args, env: vec![(CHILD.into(), what.into())], limits: Limits::default() }
}

/// Options of an empty project.
pub fn options(project: &Path) -> Options {
    let run = if std::env::var_os(SERVER).is_some() { None } else { Some(run().to_owned()) };
    Options {
        project: project.into(),
        run,
        checkpoint: Default::default(),
        files: vec![],
        real: None,
        reader: reader("read"),
        empty: true,
    }
}

/// A server on a thread of this program.
pub struct Place {
    pub dir: tempfile::TempDir,
    pub browser: Browser,
    stopper: Stopper,
    served: Option<JoinHandle<()>>,
}

impl Place {
    pub fn new() -> Place {
        Place::with(|_| {})
    }

    /// With other options.
    pub fn with(change: impl Fn(&mut Options)) -> Place {
        Place::at(tempfile::tempdir().unwrap(), change)
    }

    fn at(dir: tempfile::TempDir, change: impl Fn(&mut Options)) -> Place {
        let mut options = options(&dir.path().join("project"));
        change(&mut options);
        let server = Server::open(&options, &Listen::default()).unwrap();
        let (file, stopper) = (server.file().to_owned(), server.stopper());
        let served = Some(std::thread::spawn(move || server.run().unwrap()));
        Place { browser: Browser::enter(&file), dir, stopper, served }
    }

    /// Ends the server.
    fn end(&mut self) {
        self.stopper.stop();
        if let Some(served) = self.served.take() {
            served.join().unwrap();
        }
    }

    /// Ends the server: its folder.
    pub fn stop(mut self) -> tempfile::TempDir {
        self.end();
        std::mem::replace(&mut self.dir, tempfile::tempdir().unwrap())
    }

    /// Ends the server and begins another on the same project.
    pub fn again(mut self) -> Place {
        self.end();
        let dir = std::mem::replace(&mut self.dir, tempfile::tempdir().unwrap());
        drop(self);
        Place::at(dir, |_| {})
    }

    pub fn project(&self) -> PathBuf {
        self.dir.path().join("project")
    }

    /// The redirect file.
    pub fn file(&self) -> PathBuf {
        self.project().join(".studio/open.html")
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.end();
    }
}

/// A dance on SMPL's rig.
pub fn dance(seed: u64, seconds: f64, fps: f64) -> Clip {
    synth::corpus(seed, 1, seconds, fps).unwrap().remove(0).clip
}

/// A clip as the bytes of a file of this name.
pub fn bytes(name: &str, clip: &Clip) -> Vec<u8> {
    let motion = Motion::new(name, clip.clone());
    format::to_bytes(Path::new(name), &motion).unwrap()
}
