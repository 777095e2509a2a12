// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"

/// What is physically there when a cheap spinning triangulation lidar is driven past cylinders: plain data.
/// Every member that departs from ideal optics is 0 (off) by default. Lengths in metres unless the name says
/// otherwise (_mm, _px), angles in radians, times in seconds. Equations: README.md of this folder.
namespace rangecal::world {

/// Laser and pinhole camera side by side: a spot at depth z is seen at x = f s / z - f tan(psi) + shift on
/// the detector; the firmware takes z = (f s)_nominal / x. The difference of the constants is the range
/// curve.
struct OpticalSensor {
  double focal_mm = 14.4, baseline_mm = 50.0;                  ///< true f, s
  double nominal_focal_mm = 14.4, nominal_baseline_mm = 50.0;  ///< what the firmware believes
  double nominal_fs_mm_sq() const { return nominal_focal_mm * nominal_baseline_mm; }
  double laser_angle_rad = 0.0;    ///< psi, laser leaning towards the camera axis
  double detector_shift_mm = 0.0;  ///< detector moved along x
  double range_zero_m = 0.0;       ///< added by the firmware
  double pitch_mm = 0.006;         ///< pixel pitch p
  double k1_per_mm2 = 0.0;         ///< lens: x -> x (1 + k1 x^2)
  double spot_sigma_px =
      0.0;  ///< Gaussian spot whose centroid is taken from pixel sums; 0: continuous detector
  double centroid_step_px = 0.0;     ///< the centroid is rounded to this step
  double output_lsb_m = 0.0;         ///< the range is rounded to this step
  double near_below_m = 0.0;         ///< below this distance the firmware uses its near table ...
  double near_offset_m = 0.0;        ///< ... which is off by this
  double modulation_length_m = 0.0;  ///< ambiguity length of a phase-measuring channel; 0: none
  double crosstalk = 0.0, crosstalk_phase_rad = 0.0;  ///< leak phasor relative to the signal's
};

/// Stray light in a sector of the sensor frame: background-to-signal ratio within the centroid window.
struct AmbientLight {
  double ratio = 0.0;  ///< B / S
  double direction_rad = 0.0, half_width_rad = 0.5;
  double window_px = 8.0, spot_px = 1.0;  ///< width of the centroid window, sigma of the spot
  double window_offset_px = 0.05;         ///< centre of the window minus centre of the spot
};

/// The turning head, its encoder, its beam and its mount.
struct SpinningHead {
  double zero_rad = 0.0;              ///< encoder zero
  double zero_creep_rad_per_s = 0.0;  ///< the zero drifts
  double encoder_radius_mm = 20.0;
  double disc_offset_mm = 0.0, disc_phase_rad = 0.0;  ///< centre of the disc off the spin axis
  double ring_stretch = 0.0, ring_phase_rad = 0.0;    ///< graduation printed on an ellipse
  double gear_error = 0.0;       ///< counted angle over true angle - 1, counted from the index pulse behind
  double beam_offset_m = 0.0;    ///< q: the beam passes the spin axis at this distance, to the left
  double beam_squint_rad = 0.0;  ///< psi_0: encoder angle minus beam direction
  double tilt_rad = 0.0, tilt_axis_rad = 0.0;  ///< the whole head is turned about a level axis
  double cover_offset_m = 0.0,
         cover_phase_rad = 0.0;  ///< eccentric ring that sets the optical zero along the beam
  double cover_radius_m = 0.15;
  double beam_grid_rad = 0.0,
         beam_grid_phase_rad = 0.0;  ///< beams at multiples; bearing from first and last hit
  bool mean_of_hits = false;         ///< range: mean over the hits instead of the nearest point of the arc
  double hit_share = 1.0;            ///< share of the half-width over which hits are averaged
  double swing_rad = 0.0, swing_time_s = 0.5;  ///< yaw left when the robot stops, and its slow time constant
  double sweep_period_s = 0.2;
};

/// A landmark: a cylinder that may lean, be out of round, be dark, be moved once.
struct Cylinder {
  std::string label;
  double x_m = 0.0, y_m = 0.0;  ///< axis at the height of the sensor
  double radius_m = 0.12, nominal_radius_m = 0.12;
  double lean_rad = 0.0, lean_azimuth_rad = 0.0;
  double out_of_round = 0.0, long_axis_rad = 0.0;  ///< semi-axes R (1 +- eta)
  double reflectance = 0.7;
  double penetration_m = 0.0;     ///< light enters the surface before it is scattered
  double spot_skew_px = 0.0;      ///< colour edge or gloss shifts the centroid
  double dark_reflectance = 0.0;  ///< > 0: below the reach of exposure control, spread grows as rho^(-1/2)
  double move_time_s = -1.0, move_x_m = 0.0, move_y_m = 0.0;  ///< from this time on (negative: never)
};

/// Two-wheeled robot that drives the commanded path by its wheel encoders.
struct Robot {
  std::vector<Stop> stops;  ///< commanded poses, places
  double nominal_wheel_radius_m = 0.05, nominal_track_m = 0.4;
  double left_radius_m = 0.05, right_radius_m = 0.05, track_m = 0.4;
  double placing_sigma_m = 0.01;                                 ///< independent error of each place
  double heading_sigma_rad = 0.0;                                ///< independent error of each stop
  double walk_sigma_m = 0.0;                                     ///< slip per step, accumulating
  double stated_sigma_m = 0.01, stated_heading_sigma_rad = 0.0;  ///< what the recording says
  double heading_drift_rad_per_s = 0.0;
  double lever_x_m = 0.0, lever_y_m = 0.0;  ///< sensor in the robot frame
  int slip_stop = -1;                       ///< all stops from this one on ...
  double slip_m = 0.0;                      ///< ... are moved along its heading
  double creep_mps = 0.0,
         creep_radps = 0.0;  ///< motion during a sweep; the pose is that of the middle of the sweep
};

struct Timing {
  int repeats = 15;
  double drive_s = 60.0;  ///< from stop to stop
  double wait_s = 0.0;    ///< at the stop, before the first sweep
};

/// Temperature of the base: start + rise (1 - exp(-(soaked + t) / time)).
struct Thermal {
  double start_c = 22.0, rise_k = 10.0, time_s = 400.0;
  double soaked_s = 0.0;            ///< switched on this long before the first reading
  double zero_m_per_k = 0.0;        ///< expansion of the mount along the beam
  double pointing_rad_per_k = 0.0;  ///< base bends, laser turns
  double baseline_per_k = 0.0;      ///< expansion coefficient of the baseline
};

/// Where the random part of a reading comes from.
struct NoiseBudget {
  double speckle_per_m = 0.004;     ///< c: sd c f^2, speckle or fixed centroid noise
  double floor_m = 0.0;             ///< constant sd
  double shot_photons = 0.0;        ///< photons at 1 m, reflectance 0.7; 0: shot noise is nil
  double background_photons = 0.0;  ///< in the window, per exposure; needs shot_photons
  double spot_px = 1.0, window_px = 8.0;
  bool before_inversion = false;      ///< enters the centroid, before 1/x
  double interference_share = 0.0;    ///< readings with another lidar's spot in the window
  double interference_window = 10.0;  ///< half-width of that window, in units of the sd
  double dust_share = 0.0;            ///< readings of dust, anywhere between sensor and landmark
  double grazing_share = 0.0;  ///< readings whose beam is cut by the edge: a mixture with the wall behind
  double wall_behind_m = 1.0;  ///< distance of that wall from the landmarks
  double spot_radius_m = 0.0;  ///< w on the target, for clipping at the landmark's edge; 0: a point
  double cell_sd_m = 0.0;      ///< texture: shared by all repeats of (stop, landmark)
  double smoothing = 0.0;      ///< rho of the AR(1) filter over the repeats of a cell
  double sigma_theta_rad = 0.00872664626;  ///< 0.5 degrees
};

struct LabelSwap {
  int stop = 0, a = 0, b = 0;
};

/// The driver software and what it writes.
struct Driver {
  std::vector<LabelSwap> swaps;
  double far_limit_m = 0.0;                     ///< readings beyond are lost; 0: none
  bool intensity = false, temperature = false;  ///< columns intensity, temperature_c
};

/// A distance taped from axis to axis.
struct Tape {
  int from = 0, to = 0;
  double sigma_m = 0.002;
};

/// Effects of the simulated world that are not in the catalogue of the diagnosis.
struct UncataloguedEffects {
  double guard_m = 0.0, guard_direction_rad = 0.0,
         guard_half_width_rad = 0.4;  ///< cable guard in front of the window
  double flicker_m = 0.0, flicker_period_s = 200.0, flicker_phase_rad = 0.0;  ///< beat with the mains
  double stick_rad = 0.0, stick_step_k = 2.0;                   ///< mount turns in steps as it warms
  double dim_m = 0.0, dim_threshold = 0.0;                      ///< range error of returns below an intensity
  double ghost_m = 0.0, ghost_at_m = 2.0, ghost_width_m = 0.3;  ///< second reflection
  double detent_rad = 0.0;                                      ///< |sin 4b| - 2/pi, motor detents
  double trefoil_m = 0.0, trefoil_phase_rad = 0.0;              ///< third harmonic of range against bearing
  double knock_m = 0.0, knock_time_s = 0.0;                     ///< range jumps once for all landmarks
  double burst_factor = 0.0, burst_from_s = 0.0,
         burst_to_s = 0.0;  ///< spread (1 + factor) in a window of time
};

/// A departure that was planted.
struct Plant {
  std::string id;
  double size = 0.0;  ///< in the unit of effect_info(id)
};

struct World {
  std::string name = "ideal";
  OpticalSensor sensor;
  AmbientLight ambient;
  SpinningHead head;
  std::vector<Cylinder> landmarks;
  std::vector<Tape> tapes;
  Robot robot;
  Timing timing;
  Thermal thermal;
  NoiseBudget noise;
  Driver driver;
  UncataloguedEffects uncatalogued;
  std::vector<Plant> planted;
  std::map<std::string, double> truth;  ///< "effect.parameter_unit" -> value, of what was planted
};

/// Time from one stop to the next [s]: drive, wait, sweeps.
double stop_period_s(const World& world);
/// Duration of the run from the first reading to the last stop's [s].
double run_length_s(const World& world);

}  // namespace rangecal::world
