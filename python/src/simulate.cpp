// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/stl.h>

#include <algorithm>
#include <utility>

#include "module.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "rangecal/problems/world/scene.hpp"
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"
#include "work.hpp"

namespace rangecal::python {
namespace {

using Effects = std::map<std::string, std::map<std::string, double>>;

/// The recordings of a layout under a calibration with effects added to its own.
std::vector<std::shared_ptr<Recording>> draw(std::vector<Recording> layout, Calibration calibration,
                                             const Effects& effects, std::uint64_t seed) {
  for (const auto& [id, parameters] : effects) {
    const Effect* effect = find_effect(id);
    if (!effect) throw InputError("no effect is called '" + id + "'");
    for (const auto& [name, value] : parameters) {
      const auto& known = effect->info().parameters;
      if (std::none_of(known.begin(), known.end(),
                       [&name = name](const EffectParameter& p) { return p.name == name; }))
        throw InputError("the effect " + id + " has no parameter '" + name + "'");
    }
    calibration.effects[id] = parameters;
  }
  SimulationModel model;
  model.recordings = std::move(layout);
  model.calibration = std::move(calibration);
  std::vector<std::shared_ptr<Recording>> drawn;
  for (Recording& recording : simulate(model, seed)) {
    recording.path.clear();
    drawn.push_back(std::make_shared<Recording>(std::move(recording)));
  }
  return drawn;
}

/// The scene with effects added to its own, what is left out of them filled in.
std::shared_ptr<Recording> simulate_with(Scene scene, std::uint64_t seed, const Effects& effects) {
  for (const auto& [id, parameters] : effects) scene.effects[id] = scene_effect(scene, id, parameters);
  return std::make_shared<Recording>(simulate_scene(scene, seed));
}

using Drawn = std::shared_ptr<Recording>;

Drawn simulate_file(const std::string& path, std::uint64_t seed, const Effects& effects) {
  return run_interruptible<Drawn>(
      [=](const StageHook&) { return simulate_with(load_scene(path, SceneScope::any), seed, effects); },
      py::none());
}

Drawn simulate_text(const std::string& text, std::uint64_t seed, const Effects& effects) {
  return run_interruptible<Drawn>(
      [=](const StageHook&) {
        return simulate_with(parse_scene(text, "the scene", SceneScope::any), seed, effects);
      },
      py::none());
}

std::vector<Drawn> simulate_layout(const std::vector<Drawn>& layout, const Calibration& calibration,
                                   const Effects& effects, std::uint64_t seed) {
  const Recordings recordings({layout.begin(), layout.end()});
  return run_interruptible<std::vector<Drawn>>(
      [=](const StageHook&) {
        return draw({recordings.span().begin(), recordings.span().end()}, calibration, effects, seed);
      },
      py::none());
}

}  // namespace

void bind_simulate(py::module_& module) {
  module.def("simulate_scene_file", &simulate_file, py::arg("path"), py::arg("seed"), py::arg("effects"));
  module.def("simulate_scene_text", &simulate_text, py::arg("text"), py::arg("seed"), py::arg("effects"));
  module.def("simulate_layout", &simulate_layout, py::arg("layout"), py::arg("calibration"),
             py::arg("effects"), py::arg("seed"));

  py::class_<EffectParameter>(module, "EffectParameter")
      .def_readonly("name", &EffectParameter::name)
      .def_readonly("typical", &EffectParameter::typical)
      .def_readonly("low", &EffectParameter::low)
      .def_readonly("high", &EffectParameter::high)
      .def_readonly("discrete", &EffectParameter::discrete);
  py::class_<EffectInfo>(module, "Effect")
      .def_readonly("id", &EffectInfo::id)
      .def_readonly("channel", &EffectInfo::channel)
      .def_readonly("covariate", &EffectInfo::covariate)
      .def_readonly("physics", &EffectInfo::physics)
      .def_readonly("formula", &EffectInfo::formula)
      .def_readonly("source", &EffectInfo::source)
      .def_readonly("visible_by", &EffectInfo::visible_by)
      .def_readonly("settled_by", &EffectInfo::settled_by)
      .def_readonly("exact_twins", &EffectInfo::exact_twins)
      .def_readonly("parameters", &EffectInfo::parameters);
  module.def("effects", [] {
    std::vector<EffectInfo> all;
    for (const Effect* effect : known_effects()) all.push_back(effect->info());
    return all;
  });
  module.def("load_effects", &add_effects_by_formula, py::arg("folder"));
}

}  // namespace rangecal::python
