//! Equilibria and a motion of the mast, by the functions of its library.
//!
//! Usage: mast [MOTOR]     MOTOR [m] is added to the rest length of the cable with the motor; default 0.03
#![deny(unsafe_op_in_unsafe_fn)]

mod library;
mod mast;

use std::process::ExitCode;

use mast::{coordinate_names, member_names, Error, Mast};

fn print_tensions(quantity: &str, tension: &mast::Tension) {
    for (name, value) in member_names().zip(tension) {
        println!("{quantity} {name} {value:.12e} N");
    }
}

fn print_coordinates(quantity: &str, coordinate: &[f64]) {
    for (name, value) in coordinate_names().zip(coordinate) {
        println!("{quantity} {name} {value:.12e} m");
    }
}

fn print_motion(mast: &Mast, rest: &mast::Coordinate) -> Result<(), Error> {
    let sample_time = [0.05, 0.1, 0.15, 0.2];
    let mut start: mast::State = [0.0; library::constants::MAST_N_STATES]; // velocities are zero
    start[..rest.len()].copy_from_slice(rest);

    let motion = mast.integrate(&start, &sample_time)?;
    println!("energy start {:.12e} J", mast.total_energy(&start)?);
    for (time, state) in sample_time.iter().zip(&motion.sample) {
        print_coordinates(&format!("motion_{time:.2}s"), state);
    }
    let names: Vec<&str> = member_names().collect();
    for event in &motion.event {
        let what = if event.direction > 0 { "taut" } else { "slack" };
        println!("{what} {} {:.12e} s", names[event.which as usize], event.time);
    }
    println!("energy end {:.12e} J", mast.total_energy(&motion.end)?);
    Ok(())
}

fn run(motor: f64) -> Result<(), Error> {
    let (at_rest, moved) = (Mast::new(0.0)?, Mast::new(motor)?);
    let rest = at_rest.find_equilibrium(&Mast::nominal_coordinate())?;
    print_tensions("tension_at_rest", &at_rest.member_tension(&rest)?);
    let equilibrium = moved.find_equilibrium(&rest)?;
    print_tensions("tension_moved", &moved.member_tension(&equilibrium)?);
    print_coordinates("position_moved", &equilibrium);
    print_motion(&moved, &rest)
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    let motor = match &arguments[1..] {
        [] => Some(0.03),
        [text] => text.parse().ok(),
        _ => None,
    };
    let outcome = match motor {
        Some(motor) => run(motor),
        None => {
            eprintln!("usage: mast [MOTOR]: MOTOR is a length in metres, such as 0.03");
            return ExitCode::from(2);
        }
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
