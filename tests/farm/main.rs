//! A farm as users run it: coordinators and workers, in this process or as processes that are
//! killed, and the one promise that has to survive all of it: the same picture. No test depends on
//! how fast a machine is; what is left to chance is seeded, and the seed is printed.
#![forbid(unsafe_code)]

mod support;

mod any_farm_same_bits;
mod architecture;
mod bad_inputs;
mod bad_workers;
mod cancel;
mod command_line;
mod command_scenes;
mod containers;
mod coordinator_restart;
mod jobs_together;
mod picture_budget;
mod reference_images;
mod results;
mod stop_rules;
mod submit_to_image;
mod worker_loss;
