//! The mast in safe Rust: arrays of fixed length instead of pointers, `Result` instead of status numbers.
use std::ffi::CStr;
use std::fmt;
use std::os::raw::{c_char, c_int};

use crate::library::{self, constants::*, EquilibriumReport, Event, Run};

pub type Coordinate = [f64; MAST_N_COORDINATES]; // [m]
pub type State = [f64; MAST_N_STATES]; // coordinates [m], then velocities [m/s]
pub type Tension = [f64; MAST_N_MEMBERS]; // [N], positive in tension

const ABI_VERSION: c_int = 3; // of the structs in library.rs
const MOST_EVENTS: usize = 100;

#[derive(Debug)]
pub enum Error {
    /// A function of the library returned another status than MAST_OK.
    Status { function: &'static str, status: c_int },
    /// The library has structs of another version than library.rs.
    Version { found: c_int },
    /// The motion needs more steps than allowed.
    TooManySteps { most_steps: i64, time: f64 },
}

impl fmt::Display for Error {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Error::Status { function, status } => {
                // SAFETY: the library returns a constant text for every number.
                let text = unsafe { CStr::from_ptr(library::mast_status_text(*status)) };
                write!(out, "{function}: {} (status {status})", text.to_string_lossy())
            }
            Error::Version { found } => {
                write!(out, "the library has version {found} of the interface, not {ABI_VERSION}")
            }
            Error::TooManySteps { most_steps, time } => {
                write!(out, "the motion ended at {time} s, after {most_steps} steps")
            }
        }
    }
}

impl std::error::Error for Error {}

fn check(function: &'static str, status: c_int) -> Result<(), Error> {
    if status == MAST_OK as c_int {
        Ok(())
    } else {
        Err(Error::Status { function, status })
    }
}

/// A motion: a state at each sample time, the cables that go slack or taut, the state at the end.
pub struct Motion {
    pub sample: Vec<State>,
    pub event: Vec<Event>,
    pub end: State,
}

/// The functions of the library keep nothing: this holds the value of the motor alone.
pub struct Mast {
    input: [f64; MAST_N_INPUTS],
}

impl Mast {
    pub fn new(motor: f64) -> Result<Self, Error> {
        // SAFETY: a constant of the library; its first field is the same in all versions.
        let found = unsafe { library::mast_descriptor.abi_version };
        if found != ABI_VERSION {
            return Err(Error::Version { found });
        }
        let mut input = [0.0; MAST_N_INPUTS];
        input[MAST_INPUT_motor] = motor;
        Ok(Mast { input })
    }

    pub fn nominal_coordinate() -> Coordinate {
        // SAFETY: a constant of the library.
        unsafe { library::mast_nominal_coordinate }
    }

    pub fn find_equilibrium(&self, start: &Coordinate) -> Result<Coordinate, Error> {
        const TOLERANCE: f64 = 1e-9; // [N], largest force that remains at a free coordinate
        const MOST_ITERATIONS: c_int = 50;
        let mut coordinate = *start;
        let mut report = EquilibriumReport::default();
        let mut work = [0.0; MAST_EQUILIBRIUM_WORK];
        // SAFETY: all arrays have the lengths of the header.
        let status = unsafe {
            library::mast_find_equilibrium(
                coordinate.as_mut_ptr(),
                self.input.as_ptr(),
                TOLERANCE,
                MOST_ITERATIONS,
                &mut report,
                work.as_mut_ptr(),
            )
        };
        check("mast_find_equilibrium", status).map(|()| coordinate)
    }

    pub fn member_tension(&self, coordinate: &Coordinate) -> Result<Tension, Error> {
        let mut tension = [0.0; MAST_N_MEMBERS];
        // SAFETY: all arrays have the lengths of the header.
        let status = unsafe {
            library::mast_compute_member_tension(
                coordinate.as_ptr(),
                self.input.as_ptr(),
                tension.as_mut_ptr(),
            )
        };
        check("mast_compute_member_tension", status).map(|()| tension)
    }

    pub fn total_energy(&self, state: &State) -> Result<f64, Error> {
        let (coordinate, velocity) = state.split_at(MAST_N_COORDINATES);
        let mut energy = 0.0;
        // SAFETY: both halves of a state have MAST_N_COORDINATES numbers.
        let status = unsafe {
            library::mast_compute_total_energy(
                coordinate.as_ptr(),
                velocity.as_ptr(),
                self.input.as_ptr(),
                &mut energy,
            )
        };
        check("mast_compute_total_energy", status).map(|()| energy)
    }

    /// Integrates from time 0 to the last sample time; the motor has its value from the first moment on.
    pub fn integrate(&self, start: &State, sample_time: &[f64]) -> Result<Motion, Error> {
        const RTOL: f64 = 1e-9; // of each step
        const ATOL: f64 = 1e-12; // of each step [m and m/s]
        const MOST_STEPS: i64 = 100_000;
        let end_time = sample_time.last().copied().unwrap_or(0.0);
        let mut end = *start;
        let mut sample = vec![[0.0; MAST_N_STATES]; sample_time.len()];
        let mut event = vec![Event::default(); MOST_EVENTS];
        let mut work = vec![0.0; MAST_RK853_WORK];
        let (mut time, mut step, mut n_sampled) = (0.0, 0.0, 0); // step 0: choose one

        // SAFETY: zero is valid for every field; pointers are null then.
        let mut run: Run = unsafe { std::mem::zeroed() };
        run.watch = MAST_EVENT_CABLE as c_int; // steps end where a cable goes slack or taut
        run.event = event.as_mut_ptr();
        run.most_events = MOST_EVENTS as i64;
        // SAFETY: all arrays have the lengths of the header, and outlive the call.
        let status = unsafe {
            library::mast_integrate_rk853_run(
                end_time,
                RTOL,
                ATOL,
                MOST_STEPS,
                &mut time,
                &mut step,
                end.as_mut_ptr(),
                self.input.as_ptr(),
                sample_time.len() as i64,
                sample_time.as_ptr(),
                sample.as_mut_ptr().cast(),
                &mut n_sampled,
                &mut run,
                work.as_mut_ptr(),
            )
        };
        check("mast_integrate_rk853_run", status)?;
        if n_sampled < sample_time.len() as i64 {
            return Err(Error::TooManySteps { most_steps: MOST_STEPS, time });
        }
        event.truncate(run.n_events.min(run.most_events) as usize);
        Ok(Motion { sample, event, end })
    }
}

pub fn member_names() -> impl Iterator<Item = &'static str> {
    // SAFETY: a constant of the library, whose texts end in a zero byte.
    unsafe { library::mast_member_name.iter().map(|text| read(text)) }
}

pub fn coordinate_names() -> impl Iterator<Item = &'static str> {
    // SAFETY: as above.
    unsafe { library::mast_coordinate_name.iter().map(|text| read(text)) }
}

/// Names are C identifiers, so that they are ASCII.
unsafe fn read(text: &'static [c_char]) -> &'static str {
    unsafe { CStr::from_ptr(text.as_ptr()) }.to_str().expect("names are ASCII")
}
