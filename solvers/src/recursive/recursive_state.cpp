// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "json_matrices.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"
#include "robust/shape_json.hpp"

namespace rangecal {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char *pairs_format = "rangecal-recursive/2", *pairs_format_before = "rangecal-recursive/1";

Json json_of(const ResidualCells& cells) {
  Json json{{"alpha", list(cells.alpha)}, {"noise", list(cells.noise.parameters)}, {"bins", Json::array()}};
  for (std::size_t b = 0; b < cells.bins.size(); ++b) {
    const ResidualCells::Bin& bin = cells.bins[b];
    if (bin.first.empty() && bin.cells.empty()) continue;
    const auto& [a, slope, bend, spread, growth] = bin.reference;
    Json one{{"bin", b},
             {"reference", {a, slope, bend, spread, growth}},
             {"first", Json::array()},
             {"cells", Json::array()}};
    for (const auto& [d, y, weight] : bin.first) one["first"].push_back({d, y, weight});
    for (const auto& [place, sums] : bin.cells) one["cells"].push_back({place, sums});
    json["bins"].push_back(std::move(one));
  }
  return json;
}

/// Throws InputError for what no readings make.
void restore(const Json& json, NoiseLaw law, ResidualCells& cells) {
  const auto vector = [&](const char* field) {
    return vector_in(json.at(field), static_cast<Eigen::Index>(json.at(field).size()), field);
  };
  cells.alpha = vector("alpha");
  cells.noise = {law, vector("noise")};
  if (cells.alpha.size() > 0 && cells.noise.parameters.size() == 0)
    throw InputError("field 'residuals' has a curve without noise");
  for (const Json& one : json.at("bins")) {
    ResidualCells::Bin& bin = cells.bins.at(static_cast<std::size_t>(whole_number(one.at("bin"), "bin")));
    const Json& reference = one.at("reference");
    bin.reference = {reference.at(0), reference.at(1), reference.at(2), reference.at(3), reference.at(4)};
    if (!(std::abs(bin.reference.growth) <= 0.5))
      throw InputError("field 'reference' has a spread that no bin has");
    for (const Json& reading : one.at("first")) {
      bin.first.push_back({reading.at(0), reading.at(1), reading.at(2)});
      if (!(bin.first.back().d > 0.0 && bin.first.back().weight > 0.0))
        throw InputError("field 'first' holds a distance or a weight that is not positive");
    }
    for (const Json& cell : one.at("cells")) {
      bin.cells.push_back(
          {whole_number(cell.at(0), "cells", -1000, 1000), cell.at(1).get<std::array<double, 7>>()});
      if (!(bin.cells.back().sums[0] > 0.0))
        throw InputError("field 'cells' holds a weight that is not positive");
    }
    const auto in_order = [](const auto& a, const auto& b) { return a.place < b.place; };
    if (!std::is_sorted(bin.cells.begin(), bin.cells.end(), in_order) ||
        bin.first.empty() != (bin.reference.spread > 0.0))
      throw InputError("field 'residuals' holds a bin that no readings make");
  }
}

}  // namespace

std::string RecursiveCalibrator::to_json() const {
  Json state{{"format", pairs_format},
             {"range_m", {options_.range_min_m, options_.range_max_m}},
             {"order", options_.order ? Json(*options_.order) : Json("auto")},
             {"max_order", options_.max_order},
             {"law", to_string(options_.law)},
             {"noise_order", options_.noise_order},
             {"forget", std::isfinite(options_.forget) ? Json(options_.forget) : Json(nullptr)},
             {"used", moments_.used},
             {"timed", timed_ ? Json(*timed_) : Json(nullptr)},
             {"origin", origin_},
             {"now", now_},
             {"weights", {sum_w_, sum_w_sq_}},
             {"distances_m", {low_m_, high_m_}},
             {"last_alpha", list(last_alpha_)},
             {"last_noise", list(last_noise_)},
             {"noise_shape", to_string(options_.noise_shape)},
             {"last_shape", shape_list<Json>(last_shape_)},
             {"choose_at", choose_at_},
             {"residuals", json_of(cells_)},
             {"counts", {{"read", counts_.read}, {"used", counts_.used}, {"dropped", counts_.dropped}}}};
  const Eigen::Index size = triangle_.cols();
  state["triangle"] = Json::array();
  for (Eigen::Index i = 0; i < size; ++i)
    state["triangle"].push_back(list(Eigen::VectorXd(triangle_.row(i).tail(size - i))));
  state["bins"] = Json::array();
  for (std::size_t b = 0; b < moments_.bins.size(); ++b)
    if (moments_.bins[b].sums[0][0] != 0.0)
      state["bins"].push_back({{"bin", b}, {"sums", moments_.bins[b].sums}});
  return state.dump() + "\n";
}

RecursiveCalibrator RecursiveCalibrator::from_json(const std::string& text, const std::string& name) {
  try {
    const Json state = Json::parse(text);
    const bool gaussian = state.at("format") == pairs_format_before;
    if (!gaussian && state.at("format") != pairs_format)
      throw InputError(std::string("field 'format' is not '") + pairs_format + "'");
    const auto whole = [](const Json& parent, const char* key) { return whole_number(parent.at(key), key); };
    RecursiveOptions options;
    options.range_min_m = state.at("range_m").at(0);
    options.range_max_m = state.at("range_m").at(1);
    options.order.reset();
    if (state.at("order").is_number()) options.order = whole(state, "order");
    options.max_order = whole(state, "max_order");
    options.law = noise_law_from_string(state.at("law").get<std::string>());
    if (state.contains("noise_order")) options.noise_order = whole(state, "noise_order");
    if (state.at("forget").is_number()) options.forget = state.at("forget");
    options.noise_shape =
        gaussian ? NoiseShape::gaussian : noise_shape_from_string(state.at("noise_shape").get<std::string>());
    RecursiveCalibrator result(options);
    result.moments_.used = whole_number<std::int64_t>(state.at("used"), "used");
    if (state.at("timed").is_boolean()) result.timed_ = state.at("timed").get<bool>();
    result.origin_ = state.at("origin");
    result.now_ = state.at("now");
    result.sum_w_ = state.at("weights").at(0);
    result.sum_w_sq_ = state.at("weights").at(1);
    result.low_m_ = state.at("distances_m").at(0);
    result.high_m_ = state.at("distances_m").at(1);
    const auto last = state.at("last_alpha").get<std::vector<double>>();
    if (last.size() > static_cast<std::size_t>(options.columns()))
      throw InputError("field 'last_alpha' is too long");
    result.last_alpha_ = Eigen::VectorXd::Map(last.data(), static_cast<Eigen::Index>(last.size()));
    if (state.contains("last_noise")) {  // states of 0.1.0 have one sigma
      const auto noise = state.at("last_noise").get<std::vector<double>>();
      if (static_cast<int>(noise.size()) > options.noise_count())
        throw InputError("field 'last_noise' is too long");
      result.last_noise_ = Eigen::VectorXd::Map(noise.data(), static_cast<Eigen::Index>(noise.size()));
    } else {
      result.last_noise_ = Eigen::VectorXd::Constant(1, state.at("last_sigma").get<double>());
    }
    if (result.last_alpha_.size() > 0 && result.last_noise_.size() != options.noise_count())
      throw InputError("field 'last_noise' is not whole");
    const Json& counts = state.at("counts");
    result.counts_.read = whole(counts, "read");
    result.counts_.used = whole(counts, "used");
    for (const auto& [reason, count] : counts.at("dropped").items())
      result.counts_.dropped[reason] = whole_number(count, "dropped");
    const Eigen::Index size = result.triangle_.cols();
    const Json& triangle = state.at("triangle");
    if (static_cast<Eigen::Index>(triangle.size()) != size)
      throw InputError("field 'triangle' has not " + std::to_string(size) + " rows");
    for (Eigen::Index i = 0; i < size; ++i)
      for (Eigen::Index j = i; j < size; ++j)
        result.triangle_(i, j) = triangle.at(static_cast<std::size_t>(i)).at(static_cast<std::size_t>(j - i));
    for (const Json& bin : state.at("bins"))
      result.moments_.bins.at(static_cast<std::size_t>(whole(bin, "bin"))).sums =
          bin.at("sums").get<std::array<std::array<double, DistanceMoments::degree>, 4>>();
    if (!gaussian) {
      result.last_shape_ = shape_in_list(state.at("last_shape"));
      result.choose_at_ = whole_number<std::int64_t>(state.at("choose_at"), "choose_at");
      restore(state.at("residuals"), options.law, result.cells_);
    }
    return result;
  } catch (const Json::exception& error) {
    throw InputError(name, 0, "", "is no state of a tracked calibration: " + json_complaint(error));
  } catch (const std::out_of_range&) {
    throw InputError(name, 0, "", "field 'bins' or 'residuals' names a bin outside the range");
  } catch (const InputError& error) {
    throw InputError(name, 0, "", error.what());
  }
}

}  // namespace rangecal
