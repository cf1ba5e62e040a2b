function mast_example(motor)
% MAST_EXAMPLE  Equilibria and a motion of the mast, in Octave and MATLAB.
%
%   mast_example         motor = 0.03
%   mast_example(motor)  motor [m] is added to the rest length of the cable with the motor; a number or a text
  if nargin < 1
    motor = 0.03;
  elseif ischar(motor)
    text = motor;
    motor = str2double(text);
    if isnan(motor) && ~strcmpi(text, 'nan')
      error('mast:usage', 'usage: mast_example(motor): motor is a length in metres, such as 0.03');
    end
  end
  members = mast_mex('member_names');

  rest = mast_mex('equilibrium', [], 0);
  print_rows('tension_at_rest', members, mast_mex('member_tension', rest, 0), 'N');
  moved = mast_mex('equilibrium', rest, motor);
  print_rows('tension_moved', members, mast_mex('member_tension', moved, motor), 'N');
  print_rows('position_moved', mast_mex('coordinate_names'), moved, 'm');
  print_motion(rest, motor, members);
end

function print_motion(rest, motor, members)
  n = numel(rest);
  times = [0.05 0.1 0.15 0.2];
  coordinates = mast_mex('coordinate_names');

  [states, events] = mast_mex('motion', rest, motor, times);
  fprintf('energy start %.12g J\n', mast_mex('total_energy', rest, zeros(n, 1), motor));
  for k = 1:numel(times)
    print_rows(sprintf('motion_%.2fs', times(k)), coordinates, states(1:n, k), 'm');
  end
  for k = 1:size(events, 1)
    what = 'slack';
    if events(k, 3) > 0
      what = 'taut';
    end
    fprintf('%s %s %.12g s\n', what, members{events(k, 2)}, events(k, 1));
  end
  fprintf('energy end %.12g J\n', mast_mex('total_energy', states(1:n, end), states(n+1:end, end), motor));
end

function print_rows(quantity, names, values, unit)
  for k = 1:numel(names)
    fprintf('%s %s %.12g %s\n', quantity, names{k}, values(k), unit);
  end
end
