// SPDX-License-Identifier: BSD-3-Clause
#include "rows.hpp"

#include <algorithm>
#include <cmath>

#include "any_design.hpp"
#include "old_bounds.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "shape_error.hpp"
#include "twins.hpp"

namespace rangecal::proof {
namespace {

using world::EffectClass;
using world::EffectInfo;

template <typename Condition>
std::vector<std::string> ids(const Condition& wanted) {
  std::vector<std::string> out;
  for (const EffectInfo& info : world::effect_table())
    if (wanted(info)) out.push_back(info.id);
  return out;
}

/// These have a row of their own.
bool is_one_sided_tail(const std::string& id) { return id == "early_echo" || id == "late_return"; }

std::vector<std::string> candidates(const std::string& row, const std::string& design) {
  const bool line = design == "line";
  if (row == "noise-50")
    return ids([](const EffectInfo& e) {
      return e.catalogued && e.effect_class != EffectClass::mean && e.effect_class != EffectClass::absorbed &&
             !is_one_sided_tail(e.id);
    });
  if (row == "one-sided") return ids([](const EffectInfo& e) { return is_one_sided_tail(e.id); });
  if (row == "outside") return ids([](const EffectInfo& e) { return !e.catalogued; });
  if (row == "absorbed") {
    std::vector<std::string> out{"range_offset", "range_scale", "laser_pointing", "odometry_scale"};
    if (line) out.insert(out.end(), {"lever_arm", "tilt", "radius_scale", "arc_definition"});
    return out;
  }
  if (row == "twins") {
    std::vector<std::string> out{"bearing_offset", "bearing_drift", "heading_drift"};
    if (!line) out.insert(out.end(), {"radius_scale", "arc_definition"});
    return out;
  }
  if (row == "simulation-alpha") return {"range_offset", "range_scale", "laser_pointing"};
  if (row == "experiment")
    return {"target_reflectance", "landmark_radius",    "bearing_offset",       "bearing_drift",
            "heading_drift",      "path_curvature",     "sweep_motion",         "arc_definition",
            "radius_scale",       "range_eccentricity", "encoder_eccentricity", "lever_arm",
            "warmup_drift",       "beam_offset"};
  return ids([](const EffectInfo& e) { return e.catalogued && e.effect_class == EffectClass::mean; });
}

/// The noncentrality that a world of that number is to have, or twice its nats.
double target_of(const std::string& row, int index) {
  if (row == "noise-50") return 50.0;
  if (row == "formula-off") return index / 2 % 2 == 0 ? 400.0 : 1600.0;
  if (row == "outside" || row == "simulation-alpha") return 400.0;
  if (row == "pair") return 250.0;
  return row.starts_with("lambda-") ? std::stod(row.substr(7)) : 100.0;
}

double any_sign(const EffectInfo& info, Random& random) {
  const bool one_sided = info.id == "arc_definition" || info.id == "pixel_locking";
  const bool has_sign = info.effect_class == EffectClass::mean || info.effect_class == EffectClass::absorbed;
  const bool minus = random.uniform() < 0.5;
  return minus && has_sign && !one_sided ? -1.0 : 1.0;
}

void take(Case& c, const std::string& id, const Sized& sized) {
  c.planted = sized.planted;
  c.truth = {id};
  c.sizes = {sized.size};
  c.value = sized.value;
}

/// Labels and grids show at any size: one between half and twice the typical.
Sized free_size(const SeedModel& model, const EffectInfo& info, std::uint64_t effect_seed, double sign,
                double low, double high, Random& random) {
  double size = std::min(info.maximum, info.typical * random.uniform(low, high));
  if (info.effect_class == EffectClass::label) size = std::max(1.0, std::round(size));
  Random draw(effect_seed);
  Sized out{sign * size, 0.0, world::apply(model.clean(), info.id, sign * size, draw)};
  const bool mean = info.effect_class == EffectClass::absorbed || info.effect_class == EffectClass::mean;
  out.value = mean ? noncentrality(model, out.planted) : oracle_nats(model, out.planted);
  return out;
}

/// One to three times the bounds of old, or as many as the simulator can show, where that shows.
std::optional<Sized> large_size(const SeedModel& model, const EffectInfo& info, std::uint64_t effect_seed,
                                double sign, Random& random) {
  constexpr double least_noncentrality = 100.0;
  constexpr double rounding = 1e-6;  // a maximum may be the old bound itself
  const double most = std::min(3.0, most_old_bounds(model.clean(), info.id, effect_seed));
  const double times = std::exp(random.uniform(0.0, std::log(std::max(1.0, most))));
  if (most < 1.0 - rounding) return std::nullopt;
  const double size = sign * size_at_old_bounds(model.clean(), info.id, effect_seed, times);
  Random draw(effect_seed);
  Sized out{size, 0.0, world::apply(model.clean(), info.id, size, draw)};
  out.value = noncentrality(model, out.planted);
  return out.value >= least_noncentrality ? std::optional(out) : std::nullopt;
}

std::optional<Sized> draw_size(const std::string& row, double target, const SeedModel& model,
                               const EffectInfo& info, std::uint64_t effect_seed, Random& random) {
  const double sign = any_sign(info, random);
  if (row == "large") return large_size(model, info, effect_seed, sign, random);
  if (row == "absorbed") {
    const Sized sized = free_size(model, info, effect_seed, sign, 0.5, 1.0, random);
    return sized.value < 1.0 ? std::optional<Sized>(sized) : std::nullopt;
  }
  if (row == "one-sided") return free_size(model, info, effect_seed, sign, 0.6, 2.0, random);
  if (info.effect_class == EffectClass::label || info.effect_class == EffectClass::grid)
    return free_size(model, info, effect_seed, sign, 0.5, 2.0, random);
  const bool mean = info.effect_class == EffectClass::mean || info.effect_class == EffectClass::absorbed;
  if (row == "simulation-alpha")
    return size_for(model, info.id, target, Measure::lambda, effect_seed, sign, &model.state().alpha);
  if (mean) return size_for(model, info.id, target, Measure::lambda, effect_seed, sign);
  const double nats = row == "noise-50" ? target : 0.5 * target;
  std::optional<Sized> sized = size_for(model, info.id, nats, Measure::nats, effect_seed, sign);
  if (sized && std::abs(sized->size) < 0.1 * info.typical)  // smaller ones are no such effect
    return free_size(model, info, effect_seed, sign, 0.1, 0.2, random);
  return sized;
}

void draw_single(Case& c, const SeedModel& model, Random& random) {
  const double target = target_of(c.row, c.index);
  std::vector<std::string> left = candidates(c.row, c.design);
  while (!left.empty()) {
    const auto pick = static_cast<std::ptrdiff_t>(random.index(left.size()));
    const std::string id = left[static_cast<std::size_t>(pick)];
    left.erase(left.begin() + pick);
    const EffectInfo& info = world::effect_info(id);
    c.effect_seed = random.bits();
    const std::optional<Sized> sized = draw_size(c.row, target, model, info, c.effect_seed, random);
    if (sized) {
      const bool mean = info.effect_class == EffectClass::mean || info.effect_class == EffectClass::absorbed;
      c.in_nats = !mean;
      take(c, id, *sized);
      return;
    }
    c.out_of_reach.push_back(id + " (" + c.design + ")");
  }
  throw InputError("no effect reaches the target of row '" + c.row + "' in design '" + c.design + "'");
}

/// Two effects, each of the noncentrality asked for after the other's catalogue signature is projected out too.
void draw_pair(Case& c, const SeedModel& model, Random& random) {
  const Signatures signatures(model, c.seed);
  const std::vector<std::string> all = candidates(c.row, c.design);
  const double target = target_of(c.row, c.index);
  for (int draw = 0; draw < 400; ++draw) {
    const std::string names[2] = {all[random.index(all.size())], all[random.index(all.size())]};
    const std::uint64_t seeds[2] = {random.bits(), random.bits()};
    const double signs[2] = {any_sign(world::effect_info(names[0]), random),
                             any_sign(world::effect_info(names[1]), random)};
    if (names[0] == names[1]) continue;
    std::optional<Sized> sized[2];
    double left[2] = {0.0, 0.0};
    bool reached = true;
    for (int i = 0; i < 2 && reached; ++i) {
      sized[i] = size_for(model, names[i], target, Measure::lambda, seeds[i], signs[i]);
      if (!(reached = sized[i].has_value())) {
        c.out_of_reach.push_back(names[i] + " (" + c.design + ")");
        continue;
      }
      const std::string other[1] = {names[1 - i]};
      left[i] = signatures.left(projected(model, sized[i]->planted), other);
      reached = left[i] > 0.1 * target;  // else the two are near twins, and not two effects to be told
      if (reached && left[i] < 0.98 * target)
        sized[i] = size_for(model, names[i], target * target / left[i], Measure::lambda, seeds[i], signs[i]);
      reached = reached && sized[i].has_value();
    }
    if (!reached) continue;
    Random second(seeds[1]);
    take(c, names[0], *sized[0]);
    c.effect_seed = seeds[0];
    c.planted = world::apply(c.planted, names[1], sized[1]->size, second);
    c.truth.push_back(names[1]);
    c.sizes.push_back(sized[1]->size);
    c.value = target;
    return;
  }
  throw InputError("no pair of effects reaches the target in design '" + c.design + "'");
}

/// The row whose worlds a row has, with the same draws.
std::string drawn_as(const std::string& row) {
  if (row == "simulation-effect" || row == "closed-loop" || row == "speed") return "lambda-100";
  if (row == "simulation-many-3") return "many-3";
  if (row == "beside-unknown") return "many-2";
  return row.ends_with("-outliers") ? row.substr(0, row.rfind('-')) : row;
}

/// How many causes a row conceals at once: 3 for "many-3"; 0 for a row of one cause, or of two by its own rule.
int causes_of(const std::string& row) {
  const std::string drawn = drawn_as(row);
  return drawn.starts_with("many-") ? std::stoi(drawn.substr(5)) : 0;
}

/// Causes on the means, each of noncentrality 150 alone and of 60 or more beside the others, whose catalogue signatures are
/// projected out too: larger where they take more. Another cause is drawn only where one cannot reach that within its
/// physical maximum.
void draw_many(Case& c, const SeedModel& model, Random& random) {
  constexpr double alone = 150.0, beside_others = 60.0;
  struct Cause {
    std::string id;
    std::uint64_t seed = 0;
    double sign = 1.0;
    Sized sized;
  };
  const Signatures signatures(model, c.seed);
  const auto wanted = static_cast<std::size_t>(causes_of(c.row));
  std::vector<std::string> left = candidates(c.row, c.design);
  std::vector<Cause> causes;
  const auto others_of = [&](std::size_t i) {
    std::vector<std::string> others;
    for (std::size_t j = 0; j < causes.size(); ++j)
      if (j != i) others.push_back(causes[j].id);
    return others;
  };
  /// Enlarges cause i until the others leave enough of it; false where its maximum is reached before.
  const auto shows = [&](std::size_t i) {
    Cause& cause = causes[i];
    for (int enlarged = 0; enlarged < 4; ++enlarged) {
      const double seen = signatures.left(projected(model, cause.sized.planted), others_of(i));
      if (seen >= beside_others) return true;
      if (!(seen > 0.02 * cause.sized.value)) return false;  // nearly a twin of the others
      const double needed = 1.1 * cause.sized.value * beside_others / seen;
      std::optional<Sized> larger =
          size_for(model, cause.id, needed, Measure::lambda, cause.seed, cause.sign);
      if (!larger) return false;
      cause.sized = std::move(*larger);
    }
    return false;
  };
  while (causes.size() < wanted) {
    if (left.empty())
      throw InputError("no " + std::to_string(wanted) + " effects show beside one another in design '" +
                       c.design + "'");
    const auto pick = static_cast<std::ptrdiff_t>(random.index(left.size()));
    Cause cause{left[static_cast<std::size_t>(pick)], random.bits(), 1.0, {}};
    left.erase(left.begin() + pick);
    cause.sign = any_sign(world::effect_info(cause.id), random);
    std::optional<Sized> sized = size_for(model, cause.id, alone, Measure::lambda, cause.seed, cause.sign);
    const std::string name = cause.id + " (" + c.design + ")";
    if (sized) {
      cause.sized = std::move(*sized);
      const std::vector<Cause> before = causes;
      causes.push_back(std::move(cause));
      bool all = true;
      for (std::size_t i = 0; all && i < causes.size(); ++i) all = shows(i);
      if (all) continue;
      causes = before;
    }
    c.out_of_reach.push_back(name);
  }
  for (const Cause& cause : causes) {
    Random draw(cause.seed);
    c.planted = world::apply(c.planted, cause.id, cause.sized.size, draw);
    c.truth.push_back(cause.id);
    c.sizes.push_back(cause.sized.size);
  }
  c.value = alone;
}

/// Outliers on one side beside what is planted: too near in worlds of even number, too far in the others.
void add_outliers(Case& c, Random& random) {
  constexpr double share = 0.03;
  c.outliers = c.index / 2 % 2 == 0 ? "early_echo" : "late_return";
  c.planted = world::apply(c.planted, c.outliers, share, random);
  c.truth.push_back(c.outliers);
  c.sizes.push_back(share);
}

/// An effect outside the catalogue beside the causes, drawn as in the row `outside`. Another is drawn where the causes'
/// signatures take up more than half of its noncentrality: it would then be seen as a change of their sizes.
void add_unknown(Case& c, const SeedModel& model, Random& random) {
  const double target = target_of("outside", c.index);
  const Signatures signatures(model, c.seed);
  std::vector<std::string> left = candidates("outside", c.design);
  while (!left.empty()) {
    const auto pick = static_cast<std::ptrdiff_t>(random.index(left.size()));
    const std::string id = left[static_cast<std::size_t>(pick)];
    left.erase(left.begin() + pick);
    const EffectInfo& info = world::effect_info(id);
    const std::uint64_t seed = random.bits();
    const std::optional<Sized> sized = draw_size("outside", target, model, info, seed, random);
    const bool mean = info.effect_class == EffectClass::mean;
    if (!sized || (mean && signatures.left(projected(model, sized->planted), c.truth) < 0.5 * target)) {
      c.out_of_reach.push_back(id + " (" + c.design + ")");
      continue;
    }
    Random draw(seed);
    c.unknown = id;
    c.planted = world::apply(c.planted, id, sized->size, draw);
    c.truth.push_back(id);
    c.sizes.push_back(sized->size);
    return;
  }
  throw InputError("no effect outside the catalogue shows beside two causes in design '" + c.design + "'");
}

/// Half of the spread that the stops have in worlds of even number, twice it in the others.
void state_other_sigma(Case& c) {
  const double times = c.index / 2 % 2 == 0 ? 0.5 : 2.0;
  c.planted.robot.stated_sigma_m *= times;
  c.truth = {"stated_sigma"};
  c.sizes = {times};
}

}  // namespace

const std::vector<std::string>& row_names() {
  static const std::vector<std::string> names{"clean",
                                              "lambda-30",
                                              "lambda-50",
                                              "lambda-100",
                                              "lambda-400",
                                              "noise-50",
                                              "absorbed",
                                              "twins",
                                              "outside",
                                              "pair",
                                              "experiment",
                                              "simulation-effect",
                                              "simulation-alike",
                                              "simulation-alpha",
                                              "closed-loop",
                                              "speed",
                                              "many-2",
                                              "many-3",
                                              "many-4",
                                              "many-5",
                                              "many-2-outliers",
                                              "many-3-outliers",
                                              "many-4-outliers",
                                              "many-5-outliers",
                                              "one-sided",
                                              "everyday",
                                              "simulation-many-3",
                                              "beside-unknown",
                                              "large",
                                              "formula-off",
                                              "clean-any",
                                              "stated-sigma"};
  return names;
}

std::uint64_t world_seed(const std::string& row, std::uint64_t seed, int index, const std::string& design) {
  const std::string drawn = drawn_as(row);
  std::uint64_t number = 0;
  while (row_names()[number] != drawn) ++number;
  return seed_from("prove",
                   {seed, number, static_cast<std::uint64_t>(index), design == "line" ? 0ULL : 1ULL});
}

Case draw_case(const std::string& row, std::uint64_t seed, int index, const std::string& design) {
  if (std::find(row_names().begin(), row_names().end(), row) == row_names().end())
    throw InputError("row '" + row + "' is not one of the proof");
  if (design != "line" && design != "turning")
    throw InputError("design '" + design + "' is not line or turning");
  Case c;
  c.row = row, c.design = design, c.index = index;
  c.seed = world_seed(row, seed, index, design);
  Random random(c.seed);
  c.clean =
      row == "clean-any"
          ? any_design(random)
          : world::vary(design == "line" ? world::make_line_design() : world::make_turning_design(), random);
  c.planted = c.clean;
  if (row == "clean" || row == "clean-any" || row == "simulation-alike") {
    c.value = noncentrality(c.clean);
    return c;
  }
  if (row == "stated-sigma") {
    state_other_sigma(c);
    return c;
  }
  const SeedModel model(c.clean);
  if (row == "pair")
    draw_pair(c, model, random);
  else if (causes_of(row) > 0)
    draw_many(c, model, random);
  else
    draw_single(c, model, random);
  if (row.ends_with("-outliers")) add_outliers(c, random);
  if (row == "beside-unknown") add_unknown(c, model, random);
  if (row == "formula-off") c.shape_error = shape_error(c.clean, c.planted, c.truth.at(0), random);
  return c;
}

Recording record(const Case& c, const world::World& world, std::uint64_t run) {
  const std::uint64_t seed = seed_from("prove.recording", {c.seed, run});
  Recording recording = world::simulate(world, seed);
  if (!c.shape_error.empty()) add_shape_error(recording, c.clean, world, c.shape_error, seed);
  return recording;
}

bool has_simulation(const std::string& row) { return row.starts_with("simulation-"); }

Recording simulation_of(const Case& c) { return record(c, c.clean, 2); }

}  // namespace rangecal::proof
