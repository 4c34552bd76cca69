//! Every command, flag and environment variable. Doc comments are the help texts.

use crate::values;
use clap::{Args, Parser, Subcommand, ValueEnum};
use coordinator::Token;
use protocol::{JobState, Stop};
use scene::Look;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;
use uuid::Uuid;

/// Address of a coordinator where none is given.
const DEFAULT_URL: &str = "http://127.0.0.1:7878";

/// A self-hosted render farm for physically based pictures.
#[derive(Debug, Parser)]
#[command(
    name = "brolly",
    version,
    propagate_version = true,
    max_term_width = 100
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// How log lines look (what is logged: RUST_LOG).
    #[arg(long, global = true, env = "BROLLY_LOG_FORMAT", default_value = "text")]
    pub log_format: LogFormat,
}

/// How log lines look.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// For people.
    Text,
    /// One object a line.
    Json,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene here and now: a whole farm in one process.
    Render(Box<RenderArgs>),
    /// Run a coordinator.
    Serve(ServeArgs),
    /// Run a worker.
    Work(WorkArgs),
    /// Submit a scene to a coordinator; prints the job's id.
    Submit(Box<SubmitArgs>),
    /// List jobs.
    Jobs(JobsArgs),
    /// Show how a job stands.
    Show(JobArgs),
    /// Follow a job until it ends.
    Watch(JobArgs),
    /// Hold a job; units in work finish and are merged.
    Pause(JobArgs),
    /// Go on with a paused job.
    Resume(JobArgs),
    /// End a job.
    Cancel(JobArgs),
    /// Start a failed or cancelled job again.
    Retry(JobArgs),
    /// Give a job a new, tighter stop rule: the new total, not an addition.
    Extend(ExtendArgs),
    /// Fetch the picture of a job as it stands.
    Fetch(FetchArgs),
    /// Name every error and warning of a scene.
    Check(CheckArgs),
    /// Write a scene as Brolly's own JSON.
    Convert(ConvertArgs),
    /// Compare two pictures: MSE, relMSE, FLIP, mean.
    Compare(CompareArgs),
    /// Version, engine version, SIMD level, threads.
    Info(InfoArgs),
}

/// When a job is done: whichever comes first.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Stop rule (whichever comes first)")]
pub struct StopArgs {
    /// Samples per pixel.
    #[arg(long, value_name = "N", value_parser = values::spp)]
    pub spp: Option<u32>,
    /// Error that may remain, such as 0.02; alone it is capped at 65,536 spp.
    #[arg(long, value_name = "X", value_parser = values::positive)]
    pub noise: Option<f64>,
    /// Running time, such as 90s or 10m.
    #[arg(long, value_name = "TIME", value_parser = values::duration)]
    pub time: Option<Duration>,
}

impl StopArgs {
    /// As the coordinator takes it.
    pub fn rule(&self) -> Stop {
        Stop {
            spp: self.spp,
            noise: self.noise,
            time: self.time.map(|time| time.as_secs_f64()),
            samples: None,
        }
    }
    /// Whether nothing is asked for.
    pub fn is_empty(&self) -> bool {
        self.spp.is_none() && self.noise.is_none() && self.time.is_none()
    }
}

/// Camera and light for files without their own.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Look (for files without a camera or light of their own)")]
pub struct LookArgs {
    /// Eye position.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    pub look_from: Option<[f64; 3]>,
    /// Point looked at.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    pub look_at: Option<[f64; 3]>,
    /// Up direction.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub vfov: Option<f64>,
    /// A camera of the file, by name.
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// A material variant of the file, by name.
    #[arg(long, value_name = "NAME")]
    pub variant: Option<String>,
    /// Lat-long environment picture, .hdr or .exr.
    #[arg(long, value_name = "FILE")]
    pub env: Option<PathBuf>,
    /// Factor on the environment.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub env_strength: Option<f64>,
    /// Rotation of the environment about the up axis, degrees.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub env_rotate: Option<f64>,
    /// Alpha 0 where the sky is seen.
    #[arg(long)]
    pub transparent: bool,
}

impl LookArgs {
    /// As a job takes it, with the environment under its name in the job.
    pub fn look(&self, env: Option<String>) -> Look {
        Look {
            look_from: self.look_from,
            look_at: self.look_at,
            up: self.up,
            vfov: self.vfov,
            camera: self.camera.clone(),
            variant: self.variant.clone(),
            env,
            env_strength: self.env_strength,
            env_rotate: self.env_rotate,
            transparent: self.transparent,
        }
    }
}

/// What to render and how.
#[derive(Clone, Debug, Args)]
pub struct SceneArgs {
    /// A .json, .pbrt, .gltf, .glb, .obj or .ply file, or a folder or .zip with one in it.
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// When it is done.
    #[command(flatten)]
    pub stop: StopArgs,
    /// Camera and light.
    #[command(flatten)]
    pub look: LookArgs,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", value_parser = values::size)]
    pub size: Option<[u32; 2]>,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Frames of an animation, inclusive.
    #[arg(long, value_name = "A-B", value_parser = values::frames)]
    pub frames: Option<[u32; 2]>,
    /// Integrator: path, guided, direct, whitted, normals, albedo, depth or uv.
    #[arg(long, value_name = "NAME")]
    pub integrator: Option<String>,
    /// Render although files are missing, with stand-ins that nobody overlooks.
    #[arg(long)]
    pub allow_missing: bool,
    /// Upper bound on the radiance of an indirect path; less noise, but biased.
    #[arg(long, value_name = "X")]
    pub clamp_indirect: Option<f32>,
}

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// What to render.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Where to write the picture, .png or .exr; may be repeated.
    #[arg(short, long, value_name = "FILE", value_parser = values::picture_path)]
    pub output: Vec<PathBuf>,
    /// Workers.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    pub workers: u16,
    /// Threads of each worker [default: all cores, shared out].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print one JSON object about the render at the end.
    #[arg(long)]
    pub json: bool,
}

/// Where jobs, results and files are kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StoreArg {
    /// In the folder of `--data`.
    Embedded,
    /// In memory, gone with the process.
    Memory,
}

fn store(text: &str) -> Result<StoreArg, String> {
    match text {
        "embedded" => Ok(StoreArg::Embedded),
        "memory" => Ok(StoreArg::Memory),
        nats if nats.starts_with("nats://") => {
            Err("the NATS store is not part of this build; use embedded".into())
        }
        _ => Err("it is one of embedded, memory".into()),
    }
}

/// Arguments of `serve`.
#[derive(Debug, Args)]
pub struct ServeArgs {
    /// Address to listen on; off loopback tokens are required.
    #[arg(
        long,
        env = "BROLLY_LISTEN",
        value_name = "ADDRESS",
        default_value = "127.0.0.1:7878"
    )]
    pub listen: SocketAddr,
    /// Folder for jobs, results and files.
    #[arg(
        long,
        env = "BROLLY_DATA",
        value_name = "DIR",
        default_value = "brolly-data"
    )]
    pub data: PathBuf,
    /// Workers in this process.
    #[arg(long, env = "BROLLY_WORKERS", value_name = "N", default_value_t = 0)]
    pub workers: u16,
    /// Threads of each such worker [default: all cores, shared out].
    #[arg(long, env = "BROLLY_THREADS", value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Where jobs, results and files are kept: embedded or memory.
    #[arg(long, env = "BROLLY_STORE", value_name = "STORE", default_value = "embedded", value_parser = store)]
    pub store: StoreArg,
    /// Secret and what it allows (watch, submit, work, admin); may be repeated.
    #[arg(
        long = "token",
        env = "BROLLY_TOKENS",
        value_name = "SCOPE=SECRET",
        value_delimiter = ',',
        hide_env_values = true
    )]
    pub tokens: Vec<Token>,
    /// Listen off loopback without tokens.
    #[arg(long, env = "BROLLY_INSECURE")]
    pub insecure: bool,
}

/// Arguments of `work`.
#[derive(Debug, Args)]
pub struct WorkArgs {
    /// Address of the coordinator.
    #[arg(env = "BROLLY_URL", value_name = "URL")]
    pub url: String,
    /// Threads that render [default: all cores].
    #[arg(long, env = "BROLLY_THREADS", value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Secret with the scope work.
    #[arg(
        long,
        env = "BROLLY_TOKEN",
        value_name = "SECRET",
        hide_env_values = true
    )]
    pub token: Option<String>,
    /// Memory for prepared scenes, such as 8G [default: half of the machine's].
    #[arg(long, env = "BROLLY_MEMORY", value_name = "SIZE", value_parser = values::memory)]
    pub memory: Option<u64>,
    /// Name for people [default: the machine's].
    #[arg(long, env = "BROLLY_NAME", value_name = "NAME")]
    pub name: Option<String>,
}

/// Which coordinator.
#[derive(Clone, Debug, Args)]
pub struct RemoteArgs {
    /// Address of the coordinator.
    #[arg(long, env = "BROLLY_URL", value_name = "URL", default_value = DEFAULT_URL)]
    pub to: String,
    /// Secret with the scope submit (or watch, for looking).
    #[arg(
        long,
        env = "BROLLY_TOKEN",
        value_name = "SECRET",
        hide_env_values = true
    )]
    pub token: Option<String>,
}

/// Arguments of `submit`.
#[derive(Debug, Args)]
pub struct SubmitArgs {
    /// What to render.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Which coordinator.
    #[command(flatten)]
    pub remote: RemoteArgs,
    /// 0 to 100, higher first [default: 50].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=100))]
    pub priority: Option<u8>,
    /// Name for people [default: the scene's].
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Wait until the job ends; the exit code tells how.
    #[arg(long)]
    pub wait: bool,
    /// Where to write the picture (waits for it); may be repeated.
    #[arg(short, long, value_name = "FILE", value_parser = values::picture_path)]
    pub output: Vec<PathBuf>,
}

/// Arguments of `jobs`.
#[derive(Debug, Args)]
pub struct JobsArgs {
    /// Which coordinator.
    #[command(flatten)]
    pub remote: RemoteArgs,
    /// Only jobs in this state.
    #[arg(long, value_name = "STATE", value_parser = job_state)]
    pub state: Option<JobState>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

fn job_state(text: &str) -> Result<JobState, String> {
    serde_json::from_value(serde_json::Value::String(text.to_lowercase())).map_err(|_| {
        "it is one of checking, queued, running, paused, done, failed, cancelled".into()
    })
}

/// Arguments of commands about one job.
#[derive(Debug, Args)]
pub struct JobArgs {
    /// The job's id.
    #[arg(value_name = "ID")]
    pub id: Uuid,
    /// Which coordinator.
    #[command(flatten)]
    pub remote: RemoteArgs,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `extend`.
#[derive(Debug, Args)]
pub struct ExtendArgs {
    /// Which job.
    #[command(flatten)]
    pub job: JobArgs,
    /// When it is done.
    #[command(flatten)]
    pub stop: StopArgs,
}

/// Arguments of `fetch`.
#[derive(Debug, Args)]
pub struct FetchArgs {
    /// Which job.
    #[command(flatten)]
    pub job: JobArgs,
    /// Where to write the picture, .png or .exr; may be repeated.
    #[arg(short, long, value_name = "FILE", required = true, value_parser = values::picture_path)]
    pub output: Vec<PathBuf>,
    /// A layer instead of the picture, such as albedo.
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// Stops of exposure, for PNG.
    #[arg(long, value_name = "EV", allow_hyphen_values = true)]
    pub exposure: Option<f64>,
    /// Frame number [default: all frames].
    #[arg(long, value_name = "N")]
    pub frame: Option<u32>,
}

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// A .json, .pbrt, .gltf, .glb, .obj or .ply file, or a folder or .zip with one in it.
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Camera and light.
    #[command(flatten)]
    pub look: LookArgs,
    /// Missing files are warnings.
    #[arg(long)]
    pub allow_missing: bool,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `convert`.
#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// A .json, .pbrt, .gltf, .glb, .obj or .ply file, or a folder or .zip with one in it.
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// FILE.json, or a folder that gets scene.json; big arrays and pictures go beside it.
    #[arg(short, long, value_name = "FILE.json|DIR")]
    pub output: PathBuf,
    /// Camera and light.
    #[command(flatten)]
    pub look: LookArgs,
    /// Missing files are warnings.
    #[arg(long)]
    pub allow_missing: bool,
}

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// A picture, .exr or .png.
    #[arg(value_name = "A")]
    pub a: PathBuf,
    /// The reference, .exr or .png.
    #[arg(value_name = "B")]
    pub b: PathBuf,
    /// Exit with 1 where relMSE is above.
    #[arg(long, value_name = "X")]
    pub max_relmse: Option<f64>,
    /// Exit with 1 where the mean FLIP is above.
    #[arg(long, value_name = "X")]
    pub max_flip: Option<f64>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// Also ask whether this coordinator is well; exit with 3 if not.
    #[arg(long, value_name = "URL")]
    pub health: Option<String>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn values_may_begin_with_a_minus() {
        let parse = |line: &str| Cli::try_parse_from(line.split(' '));
        let cli = parse(
            "brolly render s.glb --look-from -1,-2,-3 --look-at -0.5,0,1 --env-rotate -90 -o a.png -o b.exr --time 90s --size 64x32",
        )
        .unwrap();
        let Command::Render(args) = cli.command else {
            panic!("not a render")
        };
        assert_eq!(args.scene.look.look_from, Some([-1.0, -2.0, -3.0]));
        assert_eq!(args.scene.look.env_rotate, Some(-90.0));
        assert_eq!(args.output.len(), 2);
        assert_eq!(args.scene.stop.rule().time, Some(90.0));
        for bad in [
            "brolly",
            "brolly render",
            "brolly render s.pbrt -o a.jpg",
            "brolly render s.pbrt --size 0x5",
            "brolly render s.pbrt --nonsense",
            "brolly serve --store nats://a",
            "brolly serve --token nonsense",
            "brolly submit s.pbrt --priority 101",
            "brolly show not-an-id",
            "brolly fetch 01890000-0000-7000-8000-000000000000",
        ] {
            assert_eq!(parse(bad).unwrap_err().exit_code(), 2, "{bad}");
        }
    }
}
