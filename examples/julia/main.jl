# Equilibria and a motion of the mast, in Julia 1.6 or newer; no packages besides the standard library.
#
# Usage: julia main.jl FOLDER [MOTOR]
# FOLDER: what `tensegrity-codegen build ../mast.toml --out FOLDER` wrote
# MOTOR [m] is added to the rest length of the cable with the motor; default 0.03
using Printf

include("Mast.jl")
using .Mast

function print_rows(quantity, names, values, unit)
    for (name, value) in zip(names, values)
        @printf("%s %s %.12g %s\n", quantity, name, value, unit)
    end
end

function print_motion(mast, rest, motor)
    times = [0.05, 0.1, 0.15, 0.2]
    start = [rest; zero(rest)]  # velocities are zero
    members, coordinates = member_names(mast), coordinate_names(mast)

    samples, events, finish = integrate(mast, start, motor, times)
    @printf("energy start %.12g J\n", total_energy(mast, start, motor))
    for (k, time) in enumerate(times)
        print_rows(@sprintf("motion_%.2fs", time), coordinates, samples[1:length(rest), k], "m")
    end
    for event in events
        what = event.direction > 0 ? "taut" : "slack"
        @printf("%s %s %.12g s\n", what, members[event.which+1], event.time)
    end
    @printf("energy end %.12g J\n", total_energy(mast, finish, motor))
end

function main(arguments)
    motor = length(arguments) == 2 ? tryparse(Float64, arguments[2]) : 0.03
    if !(length(arguments) in (1, 2)) || motor === nothing
        println(stderr, "usage: julia main.jl FOLDER [MOTOR]: MOTOR is a length in metres, such as 0.03")
        return 2
    end
    try
        mast = Library(arguments[1])
        rest = find_equilibrium(mast, nominal_coordinate(mast), 0.0)
        print_rows("tension_at_rest", member_names(mast), member_tension(mast, rest, 0.0), "N")
        moved = find_equilibrium(mast, rest, motor)
        print_rows("tension_moved", member_names(mast), member_tension(mast, moved, motor), "N")
        print_rows("position_moved", coordinate_names(mast), moved, "m")
        print_motion(mast, rest, motor)
    catch error
        println(stderr, "error: ", sprint(showerror, error))
        return 1
    end
    return 0
end

exit(main(ARGS))
