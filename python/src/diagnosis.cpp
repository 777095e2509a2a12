// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include "archive_fields.hpp"
#include "arrays.hpp"
#include "module.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "work.hpp"

namespace rangecal::python {
namespace {

DiagnoseOptions options_from(const std::optional<std::string>& curve, double alarm_rate,
                             const std::optional<std::vector<std::string>>& force,
                             const std::vector<std::string>& without, bool held_out, bool unseen,
                             bool next_experiments, bool laws,
                             const std::shared_ptr<Calibration>& simulation) {
  DiagnoseOptions options;
  options.alarm_rate = alarm_rate;
  if (curve) options.curve = curve_family_from_string(*curve);
  options.force = force;
  options.without = without;
  options.held_out = held_out;
  options.unseen = unseen;
  options.next_experiments = next_experiments;
  options.laws = laws;
  if (simulation) {
    if (!is_usable(simulation->outcome))
      throw InputError(std::string("simulation: its outcome is ") + to_string(simulation->outcome) +
                       ", so nothing can be held against it");
    options.simulation = *simulation;
  }
  return options;
}

std::shared_ptr<Diagnosis> diagnose_job(const std::vector<std::shared_ptr<Recording>>& recordings,
                                        const std::shared_ptr<Calibration>& calibration,
                                        const std::vector<std::shared_ptr<Recording>>& simulation,
                                        const std::optional<std::string>& curve, double alarm_rate,
                                        const std::optional<std::vector<std::string>>& force,
                                        const std::vector<std::string>& without, bool held_out, bool unseen,
                                        bool next_experiments, bool laws, const py::object& progress) {
  DiagnoseOptions options =
      options_from(curve, alarm_rate, force, without, held_out, unseen, next_experiments, laws, calibration);
  const Recordings job({recordings.begin(), recordings.end()});
  std::optional<Recordings> other;
  if (!simulation.empty())
    other.emplace(std::vector<std::shared_ptr<const Recording>>{simulation.begin(), simulation.end()});
  return run_interruptible<std::shared_ptr<Diagnosis>>(
      [job, other, options](const StageHook& hook) {
        DiagnoseOptions own = options;
        own.progress = hook;
        return std::make_shared<Diagnosis>(other ? diagnose_against(job.span(), other->span(), own)
                                                 : diagnose(job.span(), own));
      },
      progress);
}

std::vector<std::shared_ptr<Recording>> simulate_again(const std::shared_ptr<Diagnosis>& diagnosis,
                                                       std::uint64_t seed) {
  using Drawn = std::vector<std::shared_ptr<Recording>>;
  return run_interruptible<Drawn>(
      [=](const StageHook&) {
        Drawn recordings;
        for (Recording& recording : simulate(diagnosis->simulation, seed))
          recordings.push_back(std::make_shared<Recording>(std::move(recording)));
        return recordings;
      },
      py::none());
}

void bind_findings(py::module_& module) {
  const auto residual = [](auto BinnedResidual::*member) {
    return [member](const py::object& self) {
      return field_view(self.cast<const Finding&>().residuals, member, self);
    };
  };
  py::class_<Finding>(module, "Finding")
      .def_readonly("channel", &Finding::channel)
      .def_readonly("covariate", &Finding::covariate)
      .def_readonly("shape", &Finding::shape)
      .def_readonly("effects", &Finding::effects)
      .def_property_readonly("where", [](const Finding& f) { return std::pair(f.from, f.to); })
      .def_readonly("group", &Finding::group)
      .def_readonly("everywhere", &Finding::everywhere)
      .def_readonly("size", &Finding::size)
      .def_readonly("unit", &Finding::unit)
      .def_readonly("p_value", &Finding::p_value)
      .def_readonly("log_p", &Finding::log_p)
      .def_readonly("share", &Finding::share)
      .def_property_readonly("at", residual(&BinnedResidual::at))
      .def_property_readonly("before", residual(&BinnedResidual::before))
      .def_property_readonly("after", residual(&BinnedResidual::after))
      .def_property_readonly("std", residual(&BinnedResidual::std_dev))
      .def_property_readonly("readings", residual(&BinnedResidual::readings))
      .def(picklable<Finding>());

  py::class_<EffectEstimate>(module, "EffectEstimate")
      .def_readonly("name", &EffectEstimate::name)
      .def_readonly("estimate", &EffectEstimate::estimate)
      .def_readonly("std", &EffectEstimate::std_dev)
      .def_readonly("note", &EffectEstimate::note)
      .def_property_readonly("ci95", [](const EffectEstimate& e) { return std::pair(e.low95, e.high95); })
      .def(picklable<EffectEstimate>());
  py::class_<Explanation>(module, "Explanation")
      .def_readonly("effects", &Explanation::effects)
      .def_readonly("probability", &Explanation::probability)
      .def_readonly("parameters", &Explanation::parameters)
      .def_readonly("nll", &Explanation::nll)
      .def_readonly("heldout_nll", &Explanation::heldout_nll)
      .def_readonly("heldout_std", &Explanation::heldout_std)
      .def_readonly("p_value", &Explanation::p_value)
      .def_readonly("indistinguishable_from", &Explanation::indistinguishable_from)
      .def_readonly("separated_by", &Explanation::separated_by)
      .def_readonly("physics", &Explanation::physics)
      .def(picklable<Explanation>());
  py::class_<Unseen>(module, "Unseen")
      .def_readonly("effect", &Unseen::effect)
      .def_readonly("typical", &Unseen::typical)
      .def_readonly("detectable", &Unseen::detectable)
      .def_readonly("harm_m", &Unseen::harm_m)
      .def_readonly("settled_by", &Unseen::settled_by)
      .def(picklable<Unseen>());
  py::class_<Member>(module, "Member")
      .def_readonly("effect", &Member::effect)
      .def_readonly("probability", &Member::probability)
      .def_readonly("log_evidence_without", &Member::log_evidence_without)
      .def_readonly("heldout_nll_without", &Member::heldout_nll_without)
      .def(picklable<Member>());
  py::class_<Law>(module, "Law")
      .def_readonly("id", &Law::id)
      .def_readonly("channel", &Law::channel)
      .def_readonly("formula", &Law::formula)
      .def_readonly("variables", &Law::variables)
      .def_readonly("parameters", &Law::parameters)
      .def_readonly("log_evidence", &Law::log_evidence)
      .def_readonly("log_evidence_over_curve", &Law::log_evidence_over_curve)
      .def_readonly("agrees_with_first", &Law::agrees_with_first)
      .def_readonly("text", &Law::text)
      .def(picklable<Law>());
  py::class_<NextExperiment>(module, "NextExperiment")
      .def_readonly("change", &NextExperiment::change)
      .def_readonly("settles", &NextExperiment::settles)
      .def_readonly("power", &NextExperiment::power)
      .def(picklable<NextExperiment>());
  py::class_<FitSummary>(module, "FitSummary")
      .def_readonly("nll", &FitSummary::nll)
      .def_readonly("heldout_nll", &FitSummary::heldout_nll)
      .def_readonly("heldout_std", &FitSummary::heldout_std)
      .def_readonly("heldout_rms_range_m", &FitSummary::heldout_rms_range_m)
      .def_readonly("rms_range_m", &FitSummary::rms_range_m)
      .def_readonly("rms_bearing_rad", &FitSummary::rms_bearing_rad)
      .def_readonly("chi_sq_per_dof", &FitSummary::chi_sq_per_dof)
      .def(picklable<FitSummary>());
}

}  // namespace

void bind_diagnosis(py::module_& module) {
  bind_findings(module);
  const auto to_dict = [](const Diagnosis& d) -> py::dict {
    return py::module_::import("json").attr("loads")(diagnosis_to_json(d));
  };
  py::class_<Diagnosis, std::shared_ptr<Diagnosis>>(module, "Diagnosis", py::dynamic_attr())
      .def_property_readonly("verdict", [](const Diagnosis& d) { return to_string(d.verdict); })
      .def_property_readonly(
          "sentence",
          [](const Diagnosis& d) { return d.sentence.empty() ? verdict_sentence(d) : d.sentence; })
      .def_property_readonly("baseline",
                             [](const Diagnosis& d) { return std::make_shared<Calibration>(d.baseline); })
      .def_property_readonly("corrected",
                             [](const Diagnosis& d) { return std::make_shared<Calibration>(d.corrected); })
      .def_readonly("before", &Diagnosis::before)
      .def_readonly("after", &Diagnosis::after)
      .def_readonly("alarm_p_value", &Diagnosis::alarm_p_value)
      .def_readonly("location", &Diagnosis::location)
      .def_readonly("explanations", &Diagnosis::explanations)
      .def_readonly("final_effects", &Diagnosis::final_effects)
      .def_readonly("members", &Diagnosis::members)
      .def_readonly("evidence_omitted", &Diagnosis::evidence_omitted)
      .def_readonly("nearly_as_likely", &Diagnosis::nearly_as_likely)
      .def_readonly("twins", &Diagnosis::twins)
      .def_readonly("unseen", &Diagnosis::unseen)
      .def_readonly("next_experiments", &Diagnosis::next_experiments)
      .def_readonly("notes", &Diagnosis::notes)
      .def_readonly("laws", &Diagnosis::laws)
      .def_readonly("heldout_blocks", &Diagnosis::heldout_blocks)
      .def_readonly("heldout_effective_blocks", &Diagnosis::heldout_effective_blocks)
      .def("to_dict", to_dict, "The diagnosis as the dictionary of its file, rangecal-diagnosis/1.")
      .def("to_json", &diagnosis_to_json, "The text of its file, rangecal-diagnosis/1.")
      .def(
          "save",
          [](const Diagnosis& d, const std::string& path) {
            require_writable(path);
            write_file(path, diagnosis_to_json(d));
          },
          py::arg("path"))
      .def("simulate_all", &simulate_again, py::arg("seed"))
      .def(picklable<Diagnosis>());

  module.def("diagnose_job", &diagnose_job, py::arg("recordings"), py::arg("calibration"),
             py::arg("simulation"), py::arg("curve"), py::arg("alarm_rate"), py::arg("force"),
             py::arg("without"), py::arg("held_out"), py::arg("unseen"), py::arg("next_experiments"),
             py::arg("laws"), py::arg("progress"));
}

}  // namespace rangecal::python
