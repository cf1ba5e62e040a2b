"""
The mast in Julia: C functions by `ccall`, arrays of Julia, exceptions instead of status numbers.
"""
module Mast

using Libdl

export Library, StatusError, coordinate_names, find_equilibrium, integrate, member_names, member_tension,
    nominal_coordinate, total_energy

const ABI_VERSION = 3  # of the structs below
const MOST_EVENTS = 100

"""A function of the library returned a status other than 0."""
struct StatusError <: Exception
    name::String
    status::Int
    text::String
end

Base.showerror(io::IO, error::StatusError) =
    print(io, error.name, ": ", error.text, " (status ", error.status, ")")

"""`mast_event` of the header."""
struct Event
    time::Cdouble
    kind::Cint
    which::Cint
    direction::Cint
end

"""`mast_run` of the header, field by field; the version of the interface changes where the fields do."""
mutable struct Run
    n_accepted::Clonglong
    n_rejected::Clonglong
    n_evaluations::Clonglong
    watch::Cint
    stop::Cint
    condition::Ptr{Cvoid}
    condition_data::Ptr{Cvoid}
    event::Ptr{Event}
    most_events::Clonglong
    n_events::Clonglong
    is_stopped::Cint
    profile::Ptr{Cvoid}
    internal::NTuple{32,Cdouble}  # kept by the integrator between calls, with room for later versions
end

"""`mast_equilibrium_report` of the header."""
mutable struct EquilibriumReport
    status::Cint
    iterations::Cint
    shifted::Cint
    contraction::Cdouble
    residual::Cdouble
    smallest_pivot::Cdouble
    potential_energy::Cdouble
end

"""
    Library(folder)

The library in a folder that `tensegrity-codegen build --out` wrote, with the constants of its header.
"""
struct Library
    handle::Ptr{Cvoid}
    constant::Dict{String,Int}      # of the header
    text_length::Dict{String,Int}   # bytes of each text of a table, by the name of the table
    function Library(folder::AbstractString)
        header = read(joinpath(folder, "mast.h"), String)
        constant = Dict(String(m[1]) => parse(Int, m[2]) for m in eachmatch(r"\b(MAST_\w+) = (\d+)\b", header))
        table = r"extern MAST_API const char (\w+)\[\d+\]\[(\d+)\]"
        text_length = Dict(String(m[1]) => parse(Int, m[2]) for m in eachmatch(table, header))
        library = new(dlopen(joinpath(abspath(folder), "libmast")), constant, text_length)
        version = unsafe_load(Ptr{Cint}(symbol(library, "mast_descriptor")))
        version == ABI_VERSION || error("the library has version $version of the interface, not $ABI_VERSION")
        return library
    end
end

symbol(library::Library, name) = dlsym(library.handle, name)

function check(library::Library, name, status)
    status == 0 && return
    text = ccall(symbol(library, "mast_status_text"), Cstring, (Cint,), status)
    throw(StatusError(name, status, unsafe_string(text)))
end

function read_names(library::Library, table, count)
    first = Ptr{UInt8}(symbol(library, table))
    return [unsafe_string(first + k * library.text_length[table]) for k in 0:count-1]
end

member_names(library::Library) = read_names(library, "mast_member_name", library.constant["MAST_N_MEMBERS"])
coordinate_names(library::Library) =
    read_names(library, "mast_coordinate_name", library.constant["MAST_N_COORDINATES"])

"""Coordinates [m] of the scene."""
function nominal_coordinate(library::Library)
    values = Ptr{Cdouble}(symbol(library, "mast_nominal_coordinate"))
    return copy(unsafe_wrap(Array, values, library.constant["MAST_N_COORDINATES"]))
end

function make_input(library::Library, motor)
    input = zeros(Cdouble, library.constant["MAST_N_INPUTS"])
    input[library.constant["MAST_INPUT_motor"]+1] = motor
    return input
end

function check_length(values, count, name)
    length(values) == count || throw(DimensionMismatch("$name must have $count numbers, not $(length(values))"))
    return convert(Vector{Cdouble}, values)
end

"""Equilibrium [m] with this value of the motor [m], near `start`."""
function find_equilibrium(library::Library, start, motor)
    tolerance = 1e-9  # [N], largest force that remains at a free coordinate
    most_iterations = 50
    coordinate = copy(check_length(start, library.constant["MAST_N_COORDINATES"], "start"))
    report = EquilibriumReport(0, 0, 0, 0, 0, 0, 0)
    work = zeros(Cdouble, library.constant["MAST_EQUILIBRIUM_WORK"])
    status = ccall(
        symbol(library, "mast_find_equilibrium"), Cint,
        (Ptr{Cdouble}, Ptr{Cdouble}, Cdouble, Cint, Ref{EquilibriumReport}, Ptr{Cdouble}),
        coordinate, make_input(library, motor), tolerance, most_iterations, report, work)
    check(library, "mast_find_equilibrium", status)
    return coordinate
end

"""Tensions [N] of all members, positive in tension."""
function member_tension(library::Library, coordinate, motor)
    tension = zeros(Cdouble, library.constant["MAST_N_MEMBERS"])
    status = ccall(
        symbol(library, "mast_compute_member_tension"), Cint,
        (Ptr{Cdouble}, Ptr{Cdouble}, Ptr{Cdouble}),
        check_length(coordinate, library.constant["MAST_N_COORDINATES"], "coordinate"),
        make_input(library, motor), tension)
    check(library, "mast_compute_member_tension", status)
    return tension
end

"""Energy [J] of a state: coordinates [m], then velocities [m/s]."""
function total_energy(library::Library, state, motor)
    n = library.constant["MAST_N_COORDINATES"]
    values = check_length(state, 2n, "state")
    energy = Ref{Cdouble}(0)
    status = ccall(
        symbol(library, "mast_compute_total_energy"), Cint,
        (Ptr{Cdouble}, Ptr{Cdouble}, Ptr{Cdouble}, Ref{Cdouble}),
        values[1:n], values[n+1:2n], make_input(library, motor), energy)
    check(library, "mast_compute_total_energy", status)
    return energy[]
end

"""
Motion from a state at time 0 to the last of `sample_time`; the motor has its value from the first moment on.
Returns the states, a column for each sample time, the events, and the state at the end.
"""
function integrate(library::Library, start, motor, sample_time)
    rtol, atol = 1e-9, 1e-12  # of each step; atol in m and m/s
    most_steps = 100_000
    n = library.constant["MAST_N_STATES"]
    state = copy(check_length(start, n, "start"))
    times = convert(Vector{Cdouble}, sample_time)
    samples = zeros(Cdouble, n, length(times))
    events = Vector{Event}(undef, MOST_EVENTS)
    time, step, n_sampled = Ref{Cdouble}(0), Ref{Cdouble}(0), Ref{Clonglong}(0)  # step 0: choose one
    work = zeros(Cdouble, library.constant["MAST_RK853_WORK"])
    status, count = GC.@preserve events begin  # `run` has its address, which hides it from the collector
        run = Run(0, 0, 0, library.constant["MAST_EVENT_CABLE"], 0, C_NULL, C_NULL, pointer(events),
            MOST_EVENTS, 0, 0, C_NULL, ntuple(_ -> 0.0, 32))
        done = ccall(
            symbol(library, "mast_integrate_rk853_run"), Cint,
            (Cdouble, Cdouble, Cdouble, Clonglong, Ref{Cdouble}, Ref{Cdouble}, Ptr{Cdouble}, Ptr{Cdouble},
                Clonglong, Ptr{Cdouble}, Ptr{Cdouble}, Ref{Clonglong}, Ref{Run}, Ptr{Cdouble}),
            last(times), rtol, atol, most_steps, time, step, state, make_input(library, motor),
            length(times), times, samples, n_sampled, run, work)
        done, min(run.n_events, MOST_EVENTS)
    end
    check(library, "mast_integrate_rk853_run", status)
    n_sampled[] == length(times) || error("the motion ended at $(time[]) s, after $most_steps steps")
    return samples, events[1:count], state
end

end
