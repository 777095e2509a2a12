// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <map>
#include <string>
#include <vector>

#include "rangecal/core/scan.hpp"
#include "rangecal/solvers/extract/circle_fit.hpp"
#include "rangecal/solvers/extract/scan_noise.hpp"

namespace rangecal {

/// Things counted under the words that say why.
using Tally = std::map<std::string, long>;

/// What is looked for.
struct CylinderOptions {
  std::vector<double> radii_m{
      0.12};  ///< known radii, one for all landmarks or several kinds; empty: estimated
  double radius_min_m = 0.02, radius_max_m = 0.2;  ///< where they are estimated [m]
  double range_min_m = 0.0,
         range_max_m = std::numeric_limits<double>::infinity();  ///< readings outside are no hits
  int beams_min = 4;                                             ///< hits that a cylinder must have
  double edge_cut = 0.9;     ///< hits that pass the axis at more than this share of R are not fitted
  double jump_sigmas = 5.0;  ///< range jump that ends a segment, in sigmas of the two beams, beyond its slope
  double shape_tolerance =
      0.05;  ///< how far the outline may be from round, as a share of R (raw readings bend it)
  double range_slack_m = 0.03,
         range_slack = 0.05;  ///< raw ranges may be off by this, plus this share: width test
  double flat_nats = 4.5;     ///< log likelihood by which a straight line has to win to make a segment flat
  double fit_p_value = 1e-4;  ///< a circle fit is refused below this p-value
  int hits_min = 5;           ///< hits inside the edges that a landmark must have in one scan at least
  double round_sigmas =
      4.0;  ///< by which a landmark's bow must differ from that of a straight face (see Roundness)
  double round_slack = 0.35;  ///< how far bow and lean may be from 1 and 0, beyond as many sigmas

  double largest_m() const;  ///< the largest radius looked for
};

/// Neighbouring beams without a jump of the range between them.
struct Segment {
  std::vector<Beam> beams;
  double miss_left_rad = 0.0, miss_right_rad = 0.0;  ///< next beams beyond its ends
  bool nearer_left = false, nearer_right = false;    ///< something nearer begins there: the end is hidden
  bool view_ends = false;                            ///< the field of view ends there
};

/// Segments of one scan, in the order of bearing; a full circle has no seam. A jump ends a segment where
///   |r_b - r_a| > k sqrt(sigma_a^2 + sigma_b^2) + min(R, sqrt(2 R r gap)),
/// more than noise and the steepest step on a cylinder of the largest radius R, unless both beams lie on one straight
/// line with the two beams beyond (a wall seen askew). Beams without return are counted in `beams`.
std::vector<Segment> split_scan(const Scan& scan, const ScanNoise& noise, const CylinderOptions& options,
                                Tally& beams);

enum class FindingKind { cylinder, wall, clutter };

/// What a segment is.
struct SegmentVerdict {
  FindingKind kind = FindingKind::clutter;
  const char* reason = "";  ///< why it is no cylinder
  CircleFit fit;            ///< of a cylinder
  double flat_nats = 0.0;   ///< log likelihood, beyond what noise gives, by which a line beats the circle
  int mixed_pixels = 0;     ///< outermost hits dropped because they lie behind the arc
};

/// Judges a segment: hits enough; one end free at least; as wide as a cylinder of the radius must look from there; a
/// circle fits; a straight line does not fit clearly better; else wall, where it is long and made of straight pieces,
/// or clutter, with the reason.
SegmentVerdict judge_segment(const Segment& segment, const ScanNoise& noise, const CylinderOptions& options);

/// The circle of a segment with the radius known, by the same rules, without judging it. `cleaned`, where it is wanted, is
/// the segment without its mixed pixels.
std::optional<CircleFit> refit_segment(const Segment& segment, const ScanNoise& noise,
                                       const CylinderOptions& options, double radius_m,
                                       Segment* cleaned = nullptr);

/// How badly a cylinder of this radius explains the segment: chi-squared beyond its degrees of freedom, plus the
/// squared difference of the angular width in its standard deviations. Infinite where no circle fits. Compares radii.
double radius_misfit(const Segment& segment, const ScanNoise& noise, const CylinderOptions& options,
                     double radius_m);

}  // namespace rangecal
