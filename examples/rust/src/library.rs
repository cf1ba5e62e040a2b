//! The C functions of the library, as its header declares them.
use std::os::raw::{c_char, c_double, c_int, c_longlong, c_void};

#[allow(dead_code, non_upper_case_globals)]
pub mod constants {
    include!(concat!(env!("OUT_DIR"), "/constants.rs"));
}
use constants::*;

#[repr(C)]
pub struct Description {
    pub abi_version: c_int,
    // Texts follow, which are not read here.
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct Event {
    pub time: c_double,
    pub kind: c_int,
    pub which: c_int,
    pub direction: c_int,
}

/// `mast_run` of the header, field by field; the version of the interface changes where the fields do.
#[repr(C)]
pub struct Run {
    pub n_accepted: c_longlong,
    pub n_rejected: c_longlong,
    pub n_evaluations: c_longlong,
    pub watch: c_int,
    pub stop: c_int,
    pub condition: Option<
        unsafe extern "C" fn(c_double, *const c_double, *const c_double, *mut c_void) -> c_double,
    >,
    pub condition_data: *mut c_void,
    pub event: *mut Event,
    pub most_events: c_longlong,
    pub n_events: c_longlong,
    pub is_stopped: c_int,
    pub profile: *const c_void,
    internal: [u8; INTERNAL],
}

/// Fields that the integrator keeps between calls: 5 int and 8 double, with some more for later versions.
const INTERNAL: usize = 256;

#[repr(C)]
#[derive(Default)]
pub struct EquilibriumReport {
    pub status: c_int,
    pub iterations: c_int,
    pub shifted: c_int,
    pub contraction: c_double,
    pub residual: c_double,
    pub smallest_pivot: c_double,
    pub potential_energy: c_double,
}

extern "C" {
    pub static mast_descriptor: Description;
    pub static mast_member_name: [[c_char; MAST_MEMBER_NAME_LENGTH]; MAST_N_MEMBERS];
    pub static mast_coordinate_name: [[c_char; MAST_COORDINATE_NAME_LENGTH]; MAST_N_COORDINATES];
    pub static mast_nominal_coordinate: [c_double; MAST_N_COORDINATES];

    pub fn mast_status_text(status: c_int) -> *const c_char;
    pub fn mast_compute_member_tension(
        coordinate: *const c_double,
        input: *const c_double,
        member_tension: *mut c_double,
    ) -> c_int;
    pub fn mast_compute_total_energy(
        coordinate: *const c_double,
        velocity: *const c_double,
        input: *const c_double,
        total_energy: *mut c_double,
    ) -> c_int;
    pub fn mast_find_equilibrium(
        coordinate: *mut c_double,
        input: *const c_double,
        tolerance: c_double,
        most_iterations: c_int,
        report: *mut EquilibriumReport,
        work: *mut c_double,
    ) -> c_int;
    pub fn mast_integrate_rk853_run(
        time_end: c_double,
        rtol: c_double,
        atol: c_double,
        most_steps: c_longlong,
        time: *mut c_double,
        step: *mut c_double,
        state: *mut c_double,
        input: *const c_double,
        n_samples: c_longlong,
        sample_time: *const c_double,
        sample_state: *mut c_double,
        n_sampled: *mut c_longlong,
        run: *mut Run,
        work: *mut c_double,
    ) -> c_int;
}
