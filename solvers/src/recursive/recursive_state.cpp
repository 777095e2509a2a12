// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "json_states.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"

namespace rangecal {
namespace {

/// Of bins, those that hold something.
template <typename Bin>
struct NumberedBin {
  int number = 0;
  Bin bin;
};

template <typename Bin>
void fields(JsonFields& json, NumberedBin<Bin>& numbered) {
  json.whole("bin", numbered.number);
  fields(json, numbered.bin);
}

template <typename Bin, typename Predicate>
void bins_field(JsonFields& json, std::vector<Bin>& bins, Predicate holds) {
  std::vector<NumberedBin<Bin>> held;
  for (std::size_t b = 0; b < bins.size(); ++b)
    if (holds(bins[b])) held.push_back({static_cast<int>(b), bins[b]});
  json.required("bins", held);
  for (std::size_t i = 0; i < held.size(); ++i) {
    const auto number = static_cast<std::size_t>(held[i].number);
    json.check(number < bins.size(), "bins[" + std::to_string(i) + "].bin", "is outside the range");
    bins[number] = held[i].bin;
  }
}

}  // namespace

static void fields(JsonFields& json, DistanceMoments::Bin& bin) { json.required("sums", bin.sums); }

static void fields(JsonFields& json, ResidualCells::Reading& reading) {
  json.row(reading.d, reading.y, reading.weight);
  json.check(reading.d > 0.0 && reading.weight > 0.0, "holds a distance or a weight that is not positive");
}

static void fields(JsonFields& json, ResidualCells::Cell& cell) {
  json.row(cell.place, cell.sums);
  json.check(std::abs(cell.place) <= 1000, "is of no interval");
  json.check(cell.sums[0] > 0.0, "holds a weight that is not positive");
}

static void fields(JsonFields& json, ResidualCells::Bin& bin) {
  ResidualCells::Reference& reference = bin.reference;
  json.required("reference",
                std::tie(reference.a, reference.b, reference.c, reference.spread, reference.growth));
  json.check(std::abs(reference.growth) <= 0.5, "reference[4]", "is a spread that no bin has");
  json.required("first", bin.first);
  json.required("cells", bin.cells);
  const auto in_order = [](const auto& a, const auto& b) { return a.place < b.place; };
  json.check(std::is_sorted(bin.cells.begin(), bin.cells.end(), in_order) &&
                 bin.first.empty() == (reference.spread > 0.0),
             "is a bin that no readings make");
}

/// The noise's law is that of the options.
static void fields(JsonFields& json, ResidualCells& cells) {
  json.numbers("alpha", cells.alpha);
  json.numbers("noise", cells.noise.parameters);
  json.check(cells.alpha.size() == 0 || cells.noise.parameters.size() > 0, "has a curve without noise");
  bins_field(json, cells.bins, [](const auto& bin) { return !bin.first.empty() || !bin.cells.empty(); });
}

void fields(JsonFields& json, RecursiveCalibrator& tracked) {
  RecursiveOptions options = tracked.options_;
  const bool gaussian = json.format({"rangecal-recursive/2", "rangecal-recursive/1"}) > 0;
  json.required("range_m", std::tie(options.range_min_m, options.range_max_m));
  order_field(json, options.order);
  json.whole("max_order", options.max_order);
  json.word("law", options.law, noise_law_from_string);
  json.optional("noise_order", options.noise_order);  // states of 0.1.0 have none
  forget_field(json, options.forget);
  std::int64_t used = tracked.moments_.used;
  json.whole("used", used);
  json.required("timed", tracked.timed_);
  json.required("origin", tracked.origin_);
  json.required("now", tracked.now_);
  json.required("weights", std::tie(tracked.sum_w_, tracked.sum_w_sq_));
  json.required("distances_m", std::tie(tracked.low_m_, tracked.high_m_));
  json.numbers("last_alpha", tracked.last_alpha_);
  if (json.has("last_sigma")) {  // of 0.1.0
    tracked.last_noise_.resize(1);
    json.required("last_sigma", tracked.last_noise_[0]);
  } else {
    json.numbers("last_noise", tracked.last_noise_);
  }
  options.noise_shape = gaussian ? NoiseShape::gaussian : options.noise_shape;
  if (!gaussian) {
    json.word("noise_shape", options.noise_shape, noise_shape_from_string);
    json.required("last_shape", tracked.last_shape_);
    json.whole("choose_at", tracked.choose_at_);
  }
  if (json.reading()) {
    const RecursiveCalibrator empty(options);
    tracked.options_ = options;
    tracked.moments_ = empty.moments_;
    tracked.moments_.used = used;
    tracked.cells_ = empty.cells_;
    tracked.cells_.noise.law = options.law;
    tracked.triangle_ = empty.triangle_;
    json.check(tracked.last_alpha_.size() <= options.columns(), "last_alpha", "is too long");
    json.check(tracked.last_noise_.size() <= options.noise_count(), "last_noise", "is too long");
    json.check(tracked.last_alpha_.size() == 0 || tracked.last_noise_.size() == options.noise_count(),
               "last_noise", "is not whole");
  }
  if (!gaussian) json.required("residuals", tracked.cells_);
  counts_field(json, tracked.counts_);
  const Eigen::Index size = tracked.triangle_.cols();
  std::vector<Eigen::VectorXd> triangle;  // rows from the diagonal on
  for (Eigen::Index i = 0; i < size; ++i) triangle.push_back(tracked.triangle_.row(i).tail(size - i));
  json.required("triangle", triangle);
  json.check(static_cast<Eigen::Index>(triangle.size()) == size, "triangle",
             "has not " + std::to_string(size) + " rows");
  for (Eigen::Index i = 0; i < size; ++i) {
    const Eigen::VectorXd& row = triangle[static_cast<std::size_t>(i)];
    json.check(row.size() == size - i && row.allFinite(), "triangle[" + std::to_string(i) + "]",
               "is not " + std::to_string(size - i) + " finite numbers");
    tracked.triangle_.row(i).tail(size - i) = row;
  }
  bins_field(json, tracked.moments_.bins, [](const auto& bin) { return bin.sums[0][0] != 0.0; });
}

std::string RecursiveCalibrator::to_json() const { return json_of(*this).dump() + "\n"; }

RecursiveCalibrator RecursiveCalibrator::from_json(const std::string& text, const std::string& name) {
  RecursiveCalibrator tracked;
  read_json(text, name, tracked);
  return tracked;
}

}  // namespace rangecal
