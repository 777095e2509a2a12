// SPDX-License-Identifier: BSD-3-Clause
// The joint likelihood of docs/equations.md ("The two likelihoods") reading by reading, for R's TMB. Metres, radians, nats.
#include <TMB.hpp>

template <class Type>
Type objective_function<Type>::operator()() {
  // readings
  DATA_IVECTOR(stop);      // from 0
  DATA_IVECTOR(landmark);  // from 0
  DATA_VECTOR(range);
  DATA_VECTOR(bearing);  // empty: ranges alone
  DATA_VECTOR(radius);   // of every landmark
  // stops
  DATA_MATRIX(commanded);  // x, y, heading
  DATA_IVECTOR(place);     // of every stop, from 0, in order
  DATA_VECTOR(sigma_heading);
  DATA_INTEGER(random_walk);
  // noise: s = sigma f^p d^q, or a polynomial in d
  DATA_INTEGER(power_of_f);
  DATA_INTEGER(power_of_d);
  DATA_INTEGER(polynomial);
  // taped distances between landmarks
  DATA_IVECTOR(from);
  DATA_IVECTOR(to);
  DATA_VECTOR(tape);
  DATA_VECTOR(sigma_tape);

  PARAMETER_VECTOR(alpha);
  PARAMETER_VECTOR(tau);  // log sigma, or the polynomial's beta
  PARAMETER(log_sigma_theta);
  PARAMETER(log_sigma_s);
  PARAMETER_MATRIX(landmark_axis);
  PARAMETER_MATRIX(place_position);
  PARAMETER_VECTOR(heading);

  Type nll = 0.0;
  for (int i = 0; i < range.size(); ++i) {
    const int k = stop(i), l = landmark(i);
    const Type dx = landmark_axis(l, 0) - place_position(place(k), 0),
               dy = landmark_axis(l, 1) - place_position(place(k), 1);
    const Type d = sqrt(dx * dx + dy * dy) - radius(l);
    Type f = 0.0, spread = 0.0;
    for (int j = 0; j < alpha.size(); ++j) f += alpha(j) * pow(d, Type(j));
    if (polynomial == 1)
      for (int j = 0; j < tau.size(); ++j) spread += tau(j) * pow(d, Type(j));
    else
      spread = exp(tau(0)) * pow(f, Type(power_of_f)) * pow(d, Type(power_of_d));
    nll -= dnorm(range(i), f, spread, true);
    if (bearing.size() > 0) {
      const Type off = bearing(i) - (atan2(dy, dx) - heading(k));
      nll -= dnorm(atan2(sin(off), cos(off)), Type(0.0), exp(log_sigma_theta), true);
    }
  }

  const Type sigma_s = exp(log_sigma_s);
  for (int k = 0; k < place.size(); ++k) {
    const bool opens = k == 0 || place(k) != place(k - 1);
    const bool step = random_walk == 1 && k > 0;
    Type ex = place_position(place(k), 0) - commanded(k, 0), ey = place_position(place(k), 1) - commanded(k, 1),
         eh = heading(k) - commanded(k, 2);
    if (step) {  // what the step from the stop before, seen in that stop's frame, differs from the commanded one by
      const int b = k - 1;
      const Type x = place_position(place(k), 0) - place_position(place(b), 0),
                 y = place_position(place(k), 1) - place_position(place(b), 1);
      const Type cx = commanded(k, 0) - commanded(b, 0), cy = commanded(k, 1) - commanded(b, 1);
      const Type c = cos(heading(b)), s = sin(heading(b)), cc = cos(commanded(b, 2)), cs = sin(commanded(b, 2));
      ex = (c * x + s * y) - (cc * cx + cs * cy);
      ey = (c * y - s * x) - (cc * cy - cs * cx);
      eh = (heading(k) - heading(b)) - (commanded(k, 2) - commanded(b, 2));
    }
    if (opens) nll -= dnorm(ex, Type(0.0), sigma_s, true) + dnorm(ey, Type(0.0), sigma_s, true);
    nll -= dnorm(eh, Type(0.0), sigma_heading(k), true);
  }

  for (int j = 0; j < tape.size(); ++j) {
    const Type dx = landmark_axis(from(j), 0) - landmark_axis(to(j), 0),
               dy = landmark_axis(from(j), 1) - landmark_axis(to(j), 1);
    nll -= dnorm(tape(j), sqrt(dx * dx + dy * dy), sigma_tape(j), true);
  }
  return nll;
}
