// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <set>
#include <utility>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/names.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/yaml_reader.hpp"
#include "rangecal/solvers/study/sums.hpp"

namespace rangecal {
namespace {

constexpr auto measure_names =
    names_of<StudyMeasure>("measure", {{StudyMeasure::bias, "bias"},
                                       {StudyMeasure::variance, "variance"},
                                       {StudyMeasure::rmse, "rmse"},
                                       {StudyMeasure::rmse_over_bound, "rmse_over_bound"},
                                       {StudyMeasure::mse_ratio, "mse_ratio"},
                                       {StudyMeasure::normalised_mse, "normalised_mse"},
                                       {StudyMeasure::order, "order"},
                                       {StudyMeasure::aic, "aic"},
                                       {StudyMeasure::noise_order, "noise_order"},
                                       {StudyMeasure::coverage, "coverage"},
                                       {StudyMeasure::sigmas, "sigmas"},
                                       {StudyMeasure::failures, "failures"},
                                       {StudyMeasure::time, "time"}});

constexpr int most_points = 1'000'000;
constexpr std::size_t most_places = 50'000'000;  // stops, landmarks and batches of all points together

/// Runs `read`; an InputError without a place gets that of `node`.
template <typename Read>
auto placed(const YamlReader& node, Read read) {
  try {
    return read();
  } catch (const InputError& error) {
    node.fail(error.what());
  }
}

StudyMeasure measure_from(const YamlReader& node) {
  if (const std::optional<StudyMeasure> measure = measure_names.find(node.text())) return *measure;
  node.fail(fmt::format("'{}' is not a measure; known: {}", node.text().substr(0, 40), measure_names.list()));
}

/// "2" or "auto".
std::optional<int> order_from(const YamlReader& node) {
  if (node.text() == "auto") return std::nullopt;
  if (node.whole(0) > study_highest_order) node.fail(fmt::format("is above {}", study_highest_order));
  return node.whole(0);
}

StudyEstimator estimator_from(const YamlReader& node, std::optional<int> order) {
  StudyEstimator estimator;
  estimator.order = order;
  if (!node.is_map()) {
    estimator.label = node.text();
  } else {
    node.allow_only({"method", "weights", "order", "criterion", "divisor", "label"});
    estimator.label = node.at("method").text();
  }
  estimator.noise_order = estimator.label == "noise-order";
  if (!estimator.noise_order)
    estimator.method = placed(node, [&] { return method_from_string(estimator.label); });
  if (!node.is_map()) return estimator;
  if (node.has("weights")) {
    const YamlReader weights = node.at("weights");
    if (estimator.noise_order || estimator.method != Method::closed_form)
      weights.fail("only closed-form has weights");
    estimator.weights = placed(weights, [&] { return bearing_weights_from_string(weights.text()); });
    estimator.label += "-" + weights.text();
  }
  if (node.has("divisor")) {
    const YamlReader divisor = node.at("divisor");
    if (!estimator.noise_order) divisor.fail("only noise-order has a divisor");
    if (divisor.text() != "printed" && divisor.text() != "unbiased")
      divisor.fail(fmt::format("'{}' is neither printed nor unbiased", divisor.text().substr(0, 40)));
    estimator.divisor =
        divisor.text() == "printed" ? DifferenceDivisor::printed : DifferenceDivisor::unbiased;
    estimator.label += "-" + divisor.text();
  }
  if (node.has("order")) estimator.order = order_from(node.at("order"));
  if (node.has("criterion")) {
    const YamlReader criterion = node.at("criterion");
    if (estimator.noise_order || estimator.method != Method::closed_form)
      criterion.fail("only closed-form has a choice of criteria; the others select by AIC");
    estimator.criterion = placed(criterion, [&] { return order_criterion_from_string(criterion.text()); });
    estimator.label += std::string("-") + to_string(estimator.criterion);
  }
  if (node.has("label")) estimator.label = node.at("label").text();
  return estimator;
}

/// A number in its shortest text, so that 0.10 and 1e-1 are the same point; other texts stay.
std::string value_text(const YamlReader& node) {
  const std::string text = node.text();
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.find_first_of(",=\"\n\r") != std::string::npos || text.empty()) node.fail("is not a value");
  return error == std::errc() && end == text.data() + text.size() ? fmt::format("{}", value) : text;
}

std::vector<StudyParameter> grid_from(const YamlReader& node) {
  std::vector<StudyParameter> grid;
  double points = 1.0;
  for (const YamlReader& item : node.items()) {
    item.allow_only({"parameter", "values"});
    StudyParameter parameter{item.at("parameter").text(), {}};
    for (const StudyParameter& other : grid)
      if (other.name == parameter.name) item.fail("parameter '" + parameter.name + "' stands twice");
    std::set<std::string> seen;
    for (const YamlReader& value : item.at("values").items()) {
      parameter.values.push_back(value_text(value));
      if (!seen.insert(parameter.values.back()).second)
        value.fail("the value " + parameter.values.back() + " stands twice");
    }
    if (parameter.values.empty()) item.at("values").fail("holds no value");
    points *= static_cast<double>(parameter.values.size());
    grid.push_back(std::move(parameter));
  }
  if (points > most_points) node.fail(fmt::format("{} points are more than {}", points, most_points));
  return grid;
}

/// A scene file with its text, read once.
struct SceneFile {
  std::string name, path;
  Scene scene;
  std::string text;
};

class Scenes {
 public:
  explicit Scenes(std::filesystem::path folder) : folder_(std::move(folder)) {}

  const SceneFile& get(const std::string& name) {
    for (const SceneFile& file : files_)
      if (file.name == name) return file;
    const std::string path = (folder_ / name).lexically_normal().string();
    files_.push_back({name, path, load_scene(path), read_file(path)});
    if (!files_.back().scene.reads_bearings)
      throw InputError(path + ": sigma_theta_rad: none; a study needs a sensor that reads bearings");
    return files_.back();
  }
  std::vector<std::string> paths() const {
    std::vector<std::string> all;
    for (const SceneFile& file : files_) all.push_back(file.path);
    return all;
  }
  std::string texts() const {
    std::string all;
    for (const SceneFile& file : files_) all += file.name + "\n" + file.text + "\n";
    return all;
  }

 private:
  std::filesystem::path folder_;
  std::vector<SceneFile> files_;
};

void expand(const YamlReader& top, const std::string& base, Scenes& scenes, Study& study) {
  std::size_t count = 1, places = 0;
  for (const StudyParameter& parameter : study.grid) count *= parameter.values.size();
  for (std::size_t p = 0; p < count; ++p) {
    StudyPoint point;
    std::size_t rest = p;
    point.values.resize(study.grid.size());
    for (std::size_t g = study.grid.size(); g-- > 0; rest /= study.grid[g].values.size())
      point.values[g] = study.grid[g].values[rest % study.grid[g].values.size()];
    std::string scene = base;
    for (std::size_t g = 0; g < study.grid.size(); ++g)
      if (study.grid[g].name == "scene") scene = point.values[g];
    if (scene.empty()) top.fail("needs a scene, or a grid over scenes");
    point.scene = scenes.get(scene).scene;
    for (std::size_t g = 0; g < study.grid.size(); ++g) {
      const std::string &name = study.grid[g].name, &value = point.values[g];
      point.key += fmt::format("{}{}={}", g ? "," : "", name, value);
      if (name == "scene") continue;
      placed(top.at("grid"), [&] {
        if (name != "fit_order") {
          point.scene = with_parameter(std::move(point.scene), name, value);
        } else if (value.size() == 1 && value[0] >= '0' && value[0] <= '9') {
          point.order = value[0] - '0';
        } else {
          throw InputError("fit_order: '" + value.substr(0, 40) + "' is not 0 .. 9");
        }
        return 0;
      });
    }
    places += point.scene.stops.size() + point.scene.landmarks.size() + point.scene.batches.size();
    if (places > most_places)
      top.fail(fmt::format("the points have more than {} stops and landmarks", most_places));
    study.points.push_back(std::move(point));
  }
}

void check_together(const YamlReader& top, const Study& study) {
  const RecordingKind kind = study.points.front().scene.kind;
  for (const StudyPoint& point : study.points)
    if (point.scene.kind != kind) top.fail("scenes of both kinds");
  std::set<std::string> labels;
  for (const StudyEstimator& estimator : study.estimators) {
    if (!labels.insert(estimator.label).second)
      top.at("estimators").fail("'" + estimator.label + "' stands twice; give a label");
    if (estimator.noise_order && kind != RecordingKind::pairs)
      top.at("estimators").fail("noise-order needs a scene of kind pairs");
  }
  for (const StudyMeasure measure : study.measures) {
    const bool pairs_only = measure == StudyMeasure::noise_order || measure == StudyMeasure::aic ||
                            measure == StudyMeasure::normalised_mse;
    if (pairs_only && kind != RecordingKind::pairs)
      top.at("measures").fail(fmt::format("{} needs a scene of kind pairs", to_string(measure)));
  }
}

}  // namespace

const char* to_string(StudyMeasure measure) { return measure_names.name_of(measure); }

bool Study::measures_any(std::initializer_list<StudyMeasure> wanted) const {
  return std::any_of(wanted.begin(), wanted.end(), [&](StudyMeasure measure) {
    return std::find(measures.begin(), measures.end(), measure) != measures.end();
  });
}

std::uint64_t study_seed(const Study& study, const StudyPoint& point, int repeat, const char* purpose) {
  return seed_from("study " + study.name + " | " + point.key + " | " + purpose,
                   {static_cast<std::uint64_t>(repeat)});
}

Study load_study(const std::string& path) {
  const YamlReader top = YamlReader::open(path);
  if (top.at("format").text() != "rangecal-study/1")
    top.at("format").fail("'" + top.at("format").text().substr(0, 40) + "' is not rangecal-study/1");
  top.allow_only(
      {"format", "name", "scene", "grid", "repeats", "fit", "piece", "estimators", "measures", "curve_m"});
  Study study;
  study.name = top.at("name").text();
  if (study.name.empty()) top.at("name").fail("is empty");
  study.repeats = top.at("repeats").whole(2);
  if (top.has("piece")) study.piece = top.at("piece").whole(1);
  std::optional<int> order = 2;
  if (top.has("fit")) {
    const YamlReader fit = top.at("fit");
    fit.allow_only({"order", "max_order", "noise"});
    if (fit.has("order")) order = order_from(fit.at("order"));
    if (fit.has("max_order")) study.max_order = fit.at("max_order").whole(1);
    if (fit.has("noise"))
      study.noise = placed(fit.at("noise"), [&] { return noise_law_from_string(fit.at("noise").text()); });
  }
  if (study.max_order > study_highest_order)
    top.at("fit").fail(fmt::format("max_order is above {}", study_highest_order));
  for (const YamlReader& node : top.at("estimators").items())
    study.estimators.push_back(estimator_from(node, order));
  if (study.estimators.empty()) top.at("estimators").fail("holds no estimator");
  for (const YamlReader& node : top.at("measures").items()) {
    study.measures.push_back(measure_from(node));
    if (std::count(study.measures.begin(), study.measures.end(), study.measures.back()) > 1)
      node.fail("the measure stands twice");
  }
  if (study.measures.empty()) top.at("measures").fail("holds no measure");
  if (top.has("curve_m"))
    for (const YamlReader& node : top.at("curve_m").items()) study.curve_m.push_back(node.positive());
  else
    for (int i = 1; i <= 10; ++i) study.curve_m.push_back(0.5 * i);
  if (study.curve_m.empty()) top.at("curve_m").fail("holds no distance");
  if (top.has("grid")) study.grid = grid_from(top.at("grid"));
  Scenes scenes(std::filesystem::path(path).parent_path());
  expand(top, top.has("scene") ? top.at("scene").text() : "", scenes, study);
  check_together(top, study);
  study.files = scenes.paths();
  study.files.push_back(path);

  // All that the numbers depend on; the file's own text would make a comment another study.
  std::string all = study.name + "\n" + scenes.texts() +
                    fmt::format("{} {} {} {}\n", study.piece, study.max_order,
                                study.noise ? to_string(*study.noise) : "-", fmt::join(study.curve_m, " "));
  for (const StudyPoint& point : study.points) all += point.key + "\n";
  for (const StudyEstimator& e : study.estimators)
    all += fmt::format("{} {} {} {} {} {} {}\n", e.label, to_string(e.method), e.noise_order,
                       to_string(e.weights), static_cast<int>(e.divisor), e.order.value_or(-1),
                       static_cast<int>(e.criterion));
  for (const StudyMeasure measure : study.measures) all += std::string(to_string(measure)) + "\n";
  study.fingerprint = seed_from(all);
  return study;
}

}  // namespace rangecal
