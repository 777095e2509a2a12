% SPDX-License-Identifier: BSD-3-Clause
% Octave's side of the comparison: octave_peer.m pairs|joint SIZE SETS FOLDER METHOD CAP. fminunc with analytic gradients.
1;

function megabytes = status_megabytes (field)
  text = fileread ("/proc/self/status");
  number = regexp (text, [field '\s+(\d+)'], "tokens", "once");
  megabytes = str2double (number{1}) / 1024;
end

function [nll, gradient] = pairs_nll (x, d, y)
  f = x(1) + d .* (x(2) + d * x(3));
  if (! (min (f) > 0))
    nll = Inf; gradient = zeros (4, 1); return;
  end
  precision = exp (-2 * x(4)) ./ f .^ 4;
  r = y - f;
  q = r .^ 2 .* precision;
  nll = 2 * sum (log (f)) + numel (f) * x(4) + 0.5 * sum (q);
  g = -r .* precision + 2 * (1 - q) ./ f;
  gradient = [sum(g); g' * d; g' * d .^ 2; sum(1 - q)];
end

function [nll, gradient] = joint_nll (x, p)
  at = 5 + 2 * p.landmark; from = p.first + 2 * p.stop;   % of the y of each
  vx = x(at - 1) - x(from - 1); vy = x(at) - x(from);
  axis = hypot (vx, vy);
  ux = vx ./ axis; uy = vy ./ axis; d = axis - p.radius;
  f = x(1) + d .* (x(2) + d * x(3));
  if (! (min (f) > 0))
    nll = Inf; gradient = zeros (size (x)); return;
  end
  turn = mod (p.bearing - atan2 (uy, ux) + pi, 2 * pi) - pi;
  precision = exp (-2 * x(4)) ./ f .^ 2;
  r = p.y - f;
  q = r .^ 2 .* precision; qb = turn .^ 2 * exp (-2 * x(5));
  e = (x(p.first+1:end) - p.commanded) / p.sigma;
  nll = sum (log (f)) + numel (f) * (x(4) + x(5)) + 0.5 * (sum (q) + sum (qb) + e' * e);
  in_f = -r .* precision + (1 - q) ./ f;
  in_d = in_f .* (x(2) + 2 * d * x(3));
  in_b = -turn * exp (-2 * x(5)) ./ axis;
  gx = in_d .* ux - in_b .* uy; gy = in_d .* uy + in_b .* ux;
  L = (p.first - 5) / 2; K = numel (e) / 2;
  m = [accumarray(p.landmark, gx, [L 1])'; accumarray(p.landmark, gy, [L 1])'];
  s = [accumarray(p.stop, gx, [K 1])'; accumarray(p.stop, gy, [K 1])'];
  gradient = [sum(in_f); in_f' * d; in_f' * d .^ 2; sum(1 - q); sum(1 - qb); m(:); e / p.sigma - s(:)];
end

arguments = argv ();
kind = arguments{1}; size_ = str2double (arguments{2}); sets = str2double (arguments{3});
folder = arguments{4}; method = arguments{5}; cap = str2double (arguments{6});
options = optimset ("GradObj", "on", "TolX", 1e-12, "TolFun", 1e-14, "MaxIter", 5000, "MaxFunEvals", 20000);
spent = 0;
for set = 0:sets-1
  if (spent > cap) break; end
  file = fopen (sprintf ("%s/data-%d.bin", folder, set)); data = fread (file, Inf, "double"); fclose (file);
  if (strcmp (kind, "pairs"))
    d = data(1:size_); y = data(size_+1:end);
    start = [0; 1; 0; log(0.1)];
    call = @() fminunc (@(x) pairs_nll (x, d, y), start, options);
  else
    K = data(1); L = data(2); cells = data(3);
    p.stop = data(4:3+cells) + 1; p.landmark = data(4+cells:3+2*cells) + 1;
    p.y = data(4+2*cells:3+3*cells); p.bearing = data(4+3*cells:3+4*cells); p.radius = data(4+4*cells:3+5*cells);
    rest = data(4+5*cells:end);
    p.commanded = reshape ([rest(1:K)'; rest(K+1:2*K)'], [], 1);
    p.sigma = rest(2*K+1); start = rest(2*K+2:end); p.first = 5 + 2 * L;
    call = @() fminunc (@(x) joint_nll (x, p), start, options);
  end
  file = fopen ("/proc/self/clear_refs", "w"); fputs (file, "5"); fclose (file);
  before = status_megabytes ("VmRSS:"); best = Inf; begin = tic;
  while (true)
    once = tic;
    try
      answer = call ();
    catch
      answer = NaN;
    end
    best = min (best, toc (once));
    if (toc (begin) > 0.05) break; end
  end
  spent += toc (begin);
  file = fopen (sprintf ("%s/%s-%d.bin", folder, method, set), "w"); fwrite (file, answer, "double"); fclose (file);
  printf ("%d %.9f %.2f\n", set, best, status_megabytes ("VmHWM:") - before); fflush (stdout);
end
