// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include <nlohmann/json.hpp>

#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"

namespace rangecal {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* format_name = "rangecal-recursive/1";

Json list(const Eigen::VectorXd& values) { return std::vector<double>(values.begin(), values.end()); }

}  // namespace

std::string RecursiveCalibrator::to_json() const {
  Json state{{"format", format_name},
             {"range_m", {options_.range_min_m, options_.range_max_m}},
             {"order", options_.order ? Json(*options_.order) : Json("auto")},
             {"max_order", options_.max_order},
             {"law", to_string(options_.law)},
             {"forget", std::isfinite(options_.forget) ? Json(options_.forget) : Json(nullptr)},
             {"used", moments_.used},
             {"timed", timed_ ? Json(*timed_) : Json(nullptr)},
             {"origin", origin_},
             {"now", now_},
             {"weights", {sum_w_, sum_w_sq_}},
             {"distances_m", {low_m_, high_m_}},
             {"last_alpha", list(last_alpha_)},
             {"last_sigma", last_sigma_},
             {"counts", {{"read", counts_.read}, {"used", counts_.used}, {"dropped", counts_.dropped}}}};
  const Eigen::Index size = triangle_.cols();
  state["triangle"] = Json::array();
  for (Eigen::Index i = 0; i < size; ++i) state["triangle"].push_back(list(triangle_.row(i).tail(size - i).transpose()));
  state["bins"] = Json::array();
  for (std::size_t b = 0; b < moments_.bins.size(); ++b)
    if (moments_.bins[b].sums[0][0] != 0.0) state["bins"].push_back({{"bin", b}, {"sums", moments_.bins[b].sums}});
  return state.dump() + "\n";
}

RecursiveCalibrator RecursiveCalibrator::from_json(const std::string& text, const std::string& name) {
  try {
    const Json state = Json::parse(text);
    if (state.at("format") != format_name)
      throw InputError(name + ": field 'format' is not '" + format_name + "'");
    RecursiveOptions options;
    options.range_min_m = state.at("range_m").at(0);
    options.range_max_m = state.at("range_m").at(1);
    options.order.reset();
    if (state.at("order").is_number()) options.order = state.at("order").get<int>();
    options.max_order = state.at("max_order");
    options.law = noise_law_from_string(state.at("law").get<std::string>());
    if (state.at("forget").is_number()) options.forget = state.at("forget");
    RecursiveCalibrator result(options);
    result.moments_.used = state.at("used");
    if (state.at("timed").is_boolean()) result.timed_ = state.at("timed").get<bool>();
    result.origin_ = state.at("origin");
    result.now_ = state.at("now");
    result.sum_w_ = state.at("weights").at(0);
    result.sum_w_sq_ = state.at("weights").at(1);
    result.low_m_ = state.at("distances_m").at(0);
    result.high_m_ = state.at("distances_m").at(1);
    const auto last = state.at("last_alpha").get<std::vector<double>>();
    result.last_alpha_ = Eigen::VectorXd::Map(last.data(), static_cast<Eigen::Index>(last.size()));
    result.last_sigma_ = state.at("last_sigma");
    result.counts_.read = state.at("counts").at("read");
    result.counts_.used = state.at("counts").at("used");
    result.counts_.dropped = state.at("counts").at("dropped").get<std::map<std::string, int>>();
    const Eigen::Index size = result.triangle_.cols();
    if (static_cast<Eigen::Index>(state.at("triangle").size()) != size)
      throw InputError(name + ": field 'triangle' has not " + std::to_string(size) + " rows");
    for (Eigen::Index i = 0; i < size; ++i)
      for (Eigen::Index j = i; j < size; ++j)
        result.triangle_(i, j) = state.at("triangle").at(static_cast<std::size_t>(i)).at(static_cast<std::size_t>(j - i));
    for (const Json& bin : state.at("bins"))
      result.moments_.bins.at(bin.at("bin").get<std::size_t>()).sums =
          bin.at("sums").get<std::array<std::array<double, DistanceMoments::degree>, 4>>();
    return result;
  } catch (const Json::exception& error) {
    throw InputError(name + ": is no state of a tracked calibration: " + error.what());
  } catch (const std::out_of_range&) {
    throw InputError(name + ": field 'bins' names a bin outside the range");
  }
}

}  // namespace rangecal
