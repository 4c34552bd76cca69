//! What the container files say exists. They are checked without a container engine.

use clap::CommandFactory;
use cli::args::Cli;
use std::collections::BTreeSet;

const DOCKERFILE: &str = include_str!("../../docker/Dockerfile");
const COMPOSE: &str = include_str!("../../docker/compose.yaml");

/// Set by people for compose, never read by the program.
const OF_COMPOSE: [&str; 2] = ["BROLLY_ADMIN_SECRET", "BROLLY_WORK_SECRET"];

fn variables(text: &str) -> BTreeSet<String> {
    text.match_indices("BROLLY_")
        .map(|(at, _)| {
            text[at..]
                .chars()
                .take_while(|c| c.is_ascii_uppercase() || *c == '_')
                .collect()
        })
        .collect()
}

#[test]
fn every_variable_is_one_of_the_program() {
    let mut known = BTreeSet::new();
    for command in Cli::command().get_subcommands() {
        for argument in command.get_arguments() {
            known.extend(
                argument
                    .get_env()
                    .map(|env| env.to_string_lossy().into_owned()),
            );
        }
    }
    assert!(known.contains("BROLLY_TOKENS") && known.contains("BROLLY_DATA"));
    for text in [DOCKERFILE, COMPOSE] {
        for variable in variables(text) {
            let of_compose = OF_COMPOSE.contains(&variable.as_str());
            assert!(known.contains(&variable) || of_compose, "{variable}");
        }
    }
}

/// The commands of the files parse, with the environment that the files give them.
#[test]
fn every_command_parses() {
    let parse = |args: &[&str]| {
        let line = [&["brolly"], args].concat();
        let parsed = Cli::command().try_get_matches_from(line);
        // A missing URL comes from the environment there.
        parsed.map(drop).map_err(|e| e.to_string())
    };
    assert_eq!(parse(&["serve", "--listen", "0.0.0.0:7878"]), Ok(()));
    assert_eq!(parse(&["work", "http://serve:7878"]), Ok(()));
    let health = ["info", "--health", "http://127.0.0.1:7878"];
    assert_eq!(parse(&health), Ok(()));
    for word in health {
        assert!(DOCKERFILE.contains(&format!("\"{word}\"")), "{word}");
    }
    for command in ["serve", "work"] {
        assert!(COMPOSE.contains(&format!("command: [\"{command}\"]")));
    }
    assert!(DOCKERFILE.contains("USER brolly"), "not root");
    assert!(DOCKERFILE.contains("--package brolly-cli --bin brolly"));
}

/// Every flag of a server is an environment variable as well.
#[test]
fn every_flag_of_a_server_is_a_variable() {
    for name in ["serve", "work"] {
        let command = Cli::command();
        let command = command.find_subcommand(name).expect("the command").clone();
        for argument in command.get_arguments() {
            let id = argument.get_id().as_str();
            if ["help", "version"].contains(&id) {
                continue;
            }
            let env = argument.get_env().map(|e| e.to_string_lossy().into_owned());
            assert!(env.is_some_and(|e| e.starts_with("BROLLY_")), "{name} {id}");
        }
    }
}
