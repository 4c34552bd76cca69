//! The program itself, as processes that can be killed.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Where cargo put the program.
const PROGRAM: &str = env!("CARGO_BIN_EXE_brolly-under-test");

/// What a finished command said.
#[derive(Debug)]
pub struct BrollyOutput {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

/// A command without anything from the environment that could change its behaviour.
fn command(args: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    for (name, _) in std::env::vars() {
        if name.starts_with("BROLLY_") || name == "RUST_LOG" {
            command.env_remove(name);
        }
    }
    command.args(args).stdin(Stdio::null());
    command
}

/// Runs a command to its end.
pub fn brolly(args: &[&str], env: &[(&str, &str)]) -> BrollyOutput {
    let output = command(args)
        .envs(env.iter().copied())
        .output()
        .expect("the program starts");
    BrollyOutput {
        code: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// A running server; killed when dropped, by its own handle.
pub struct Brolly {
    child: Child,
    log: Arc<Mutex<String>>,
}

impl Brolly {
    /// Starts a command that runs until it is told to stop.
    pub fn start(args: &[&str]) -> Self {
        let mut child = command(args)
            .env("RUST_LOG", "info")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let log = Arc::new(Mutex::new(String::new()));
        let stderr = child.stderr.take().expect("stderr is piped");
        let sink = log.clone();
        // Ends with the process.
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                let mut log = sink.lock().expect("the log");
                log.push_str(&line);
                log.push('\n');
            }
        });
        Brolly { child, log }
    }

    /// Starts `brolly serve` and waits until it listens. Port 0 lets the system choose.
    pub fn serve(data: &Path, port: u16) -> (Self, u16) {
        let listen = format!("127.0.0.1:{port}");
        let data = data.to_str().expect("a UTF-8 path");
        let mut server = Brolly::start(&["serve", "--listen", &listen, "--data", data]);
        let marker = "serves on http://127.0.0.1:";
        for _ in 0..1200 {
            let log = server.log();
            if let Some(at) = log.find(marker) {
                let digits: String = log[at + marker.len()..]
                    .chars()
                    .take_while(char::is_ascii_digit)
                    .collect();
                return (server, digits.parse().expect("a port"));
            }
            if let Some(status) = server.child.try_wait().expect("the state of a child") {
                panic!("serve ended with {status}: {log}");
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("serve does not come up: {}", server.log());
    }

    /// Starts `brolly work`.
    pub fn work(url: &str, threads: usize) -> Self {
        Brolly::start(&[
            "work",
            url,
            "--threads",
            &threads.to_string(),
            "--memory",
            "512M",
        ])
    }

    /// What it logged.
    pub fn log(&self) -> String {
        self.log.lock().expect("the log").clone()
    }

    /// SIGKILL, by the handle of the child: no other process can be hit.
    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// The most bytes of memory that it had so far, where the system tells.
    pub fn peak_memory(&self) -> Option<u64> {
        let path = format!("/proc/{}/status", self.child.id());
        let status = std::fs::read_to_string(path).ok()?;
        let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
        let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
        Some(kib << 10)
    }

    /// SIGTERM, SIGSTOP or SIGCONT.
    pub fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        let status = Command::new("kill")
            .args([&format!("-{name}"), &pid])
            .status()
            .expect("kill runs");
        assert!(status.success());
    }

    /// Waits for the end by itself.
    pub fn wait(&mut self) -> i32 {
        for _ in 0..1200 {
            if let Some(status) = self.child.try_wait().expect("the state of a child") {
                return status.code().unwrap_or(-1);
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("it does not end: {}", self.log());
    }
}

impl Drop for Brolly {
    fn drop(&mut self) {
        self.kill();
        if std::thread::panicking() {
            eprintln!("-- log of a process --\n{}", self.log());
        }
        if let Some(mut rest) = self.child.stderr.take() {
            let _ = rest.read_to_end(&mut Vec::new());
        }
    }
}
