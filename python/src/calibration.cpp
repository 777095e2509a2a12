// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/calibration.hpp"

#include <pybind11/stl.h>

#include <cmath>

#include "archive_fields.hpp"
#include "arrays.hpp"
#include "module.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/solvers/calibrate/curve.hpp"

namespace rangecal::python {
namespace {

const Calibration& of(const py::object& self) { return self.cast<const Calibration&>(); }

py::array noise_std(const Calibration& c) {
  py::array_t<double> array(static_cast<py::ssize_t>(c.noise_estimates.size()));
  for (std::size_t i = 0; i < c.noise_estimates.size(); ++i)
    array.mutable_data()[i] = c.noise_estimates[i].std_dev.value_or(nan);
  return array;
}

std::optional<double> value_of(const std::optional<Estimate>& e) {
  return e ? std::optional(e->value) : std::nullopt;
}
std::optional<double> std_of(const std::optional<Estimate>& e) { return e ? e->std_dev : std::nullopt; }

py::dict curve(const Calibration& c) {
  py::dict entry;
  entry["family"] = to_string(c.scale.family);
  if (c.scale.is_reciprocal()) {
    entry["offset_m"] = c.scale.offset_m;
    entry["offset_std_m"] = c.scale.offset_std_m;
  }
  if (c.scale.spline) {
    entry["knots_m"] = c.scale.spline->u.knots();
    entry["values_m"] = c.scale.spline->u.values();
    entry["covariance"] = c.scale.spline->covariance;
    entry["degrees"] = c.scale.spline->degrees;
  }
  return entry;
}

py::dict noise_shapes(const Calibration& c) {
  py::dict shapes;
  for (const auto& [channel, shape] : c.noise_shapes) {
    py::dict entry;
    entry["family"] = shape.family;
    for (const auto& [name, value] : shape.parameters) {
      const auto std_dev = shape.std_dev.find(name);
      entry[py::str(name)] = value;
      entry[py::str(name + "_std")] =
          std_dev == shape.std_dev.end() ? py::object(py::none()) : py::object(py::float_(std_dev->second));
    }
    shapes[py::str(channel)] = entry;
  }
  return shapes;
}

/// {rms_raw_m, ...} of Calibration::left_out; None where there is none.
py::object left_out(const Calibration& c) {
  if (!c.left_out) return py::none();
  const LeftOutCheck& check = *c.left_out;
  py::dict entry;
  entry["groups"] = check.groups;
  entry["what"] = check.what;
  entry["rms_raw_m"] = check.rms_raw_m;
  entry["rms_raw_std_m"] = check.rms_raw_std_m;
  entry["rms_corrected_m"] = check.rms_corrected_m;
  entry["rms_corrected_std_m"] = check.rms_corrected_std_m;
  entry["halves_p_value"] = check.halves_p_value;
  entry["better_than_raw"] = check.usable;
  entry["reason"] = check.reason;
  return entry;
}

py::object misfit(const Calibration& c) {
  if (!c.misfit) return py::none();
  py::dict entry;
  entry["factor"] = c.misfit->factor;
  entry["threshold"] = c.misfit->threshold;
  entry["where"] = c.misfit->where;
  entry["clusters"] = c.misfit->clusters;
  return entry;
}

py::list outliers(const Calibration& c) {
  py::list list;
  for (const OutlierReading& one : c.outliers) {
    py::dict entry;
    entry["recording"] = one.recording;
    entry["row"] = one.row;
    entry["channel"] = one.channel;
    entry["sigmas"] = one.sigmas;
    entry["reason"] = one.reason;
    list.append(entry);
  }
  return list;
}

template <typename Items>
std::vector<std::string> labels(const Items& items) {
  std::vector<std::string> texts;
  for (const auto& item : items) texts.push_back(item.label);
  return texts;
}

py::object effects_covariance(const py::object& self) {
  const auto& known = of(self).effects_covariance;
  return known ? py::object(view(known->matrix, self)) : py::none();
}
std::vector<std::string> effects_covariance_parameters(const Calibration& c) {
  return c.effects_covariance ? c.effects_covariance->parameters : std::vector<std::string>{};
}

py::array landmarks(const py::object& self) {
  const auto& items = of(self).landmarks;
  return field_view(items, items.empty() ? nullptr : items.front().position_m.data(), 2, self);
}

py::array stops(const py::object& self) {
  const auto& items = of(self).stops;
  return field_view(items, items.empty() ? nullptr : &items.front().pose.x_m, 3, self);
}

/// (n, 2, 2), NaN where a landmark has no such covariance.
template <std::optional<Eigen::Matrix2d> LandmarkEstimate::*which>
py::array landmark_covariance(const Calibration& c) {
  py::array_t<double> array({static_cast<py::ssize_t>(c.landmarks.size()), py::ssize_t{2}, py::ssize_t{2}});
  auto at = array.mutable_unchecked<3>();
  for (std::size_t i = 0; i < c.landmarks.size(); ++i)
    for (py::ssize_t a = 0; a < 2; ++a)
      for (py::ssize_t b = 0; b < 2; ++b)
        at(static_cast<py::ssize_t>(i), a, b) =
            c.landmarks[i].*which ? (*(c.landmarks[i].*which))(a, b) : nan;
  return array;
}

/// One number of every point of the curve, NaN where there is none.
template <typename Get>
auto along_curve(Get get) {
  return [get](const Calibration& c, const py::array_t<double, py::array::forcecast>& distance_m) {
    const auto one = [&](double d) {
      const std::optional<CurvePoint> point = curve_point(c, d);
      return point ? get(*point) : nan;
    };
    return py::vectorize(one)(distance_m);
  };
}

py::dict to_dict(const Calibration& c) {
  return py::module_::import("json").attr("loads")(calibrations_to_json({c}));
}

}  // namespace

void bind_calibration(py::module_& module) {
  py::class_<Calibration, std::shared_ptr<Calibration>>(module, "Calibration", py::dynamic_attr())
      .def_property_readonly("method", [](const Calibration& c) { return to_string(c.method); })
      .def_property_readonly(
          "kind", [](const Calibration& c) { return c.kind == RecordingKind::pairs ? "pairs" : "landmarks"; })
      .def_property_readonly("outcome", [](const Calibration& c) { return to_string(c.outcome); })
      .def_property_readonly("usable",
                             [](const Calibration& c) { return is_usable(c.outcome) && c.alpha.size() > 0; })
      .def_readonly("reason", &Calibration::reason)
      .def_property_readonly("order", &Calibration::order)
      .def_property_readonly("curve", &curve)
      .def_property_readonly("alpha", [](const py::object& self) { return view(of(self).alpha, self); })
      .def_property_readonly("covariance",
                             [](const py::object& self) { return view(of(self).alpha_covariance, self); })
      .def_property_readonly(
          "covariance_with_choice",
          [](const py::object& self) { return view(of(self).covariance_with_choice, self); })
      .def_property_readonly(
          "covariance_by_stops",
          [](const py::object& self) { return view(of(self).alpha_covariance_by_stops, self); })
      .def_property_readonly(
          "covariance_by_landmarks",
          [](const py::object& self) { return view(of(self).alpha_covariance_by_landmarks, self); })
      .def_property_readonly("misfit", &misfit)
      .def_property_readonly("left_out", &left_out)
      .def_property_readonly("bound_alpha_std",
                             [](const py::object& self) { return view(of(self).bound_alpha_std, self); })
      .def_readonly("covariance_reason", &Calibration::covariance_reason)
      .def_property_readonly("noise_law", [](const Calibration& c) { return to_string(c.noise.law); })
      .def_property_readonly("noise_parameters",
                             [](const py::object& self) { return view(of(self).noise.parameters, self); })
      .def_property_readonly("noise_std", &noise_std)
      .def_property_readonly("noise_shapes", &noise_shapes)
      .def_readonly("outlier_count", &Calibration::outlier_count)
      .def_property_readonly("outliers", &outliers)
      .def_property_readonly("sigma_theta_rad",
                             [](const Calibration& c) { return value_of(c.sigma_theta_rad); })
      .def_property_readonly("sigma_theta_std_rad",
                             [](const Calibration& c) { return std_of(c.sigma_theta_rad); })
      .def_property_readonly("sigma_s_m", [](const Calibration& c) { return value_of(c.sigma_s_m); })
      .def_property_readonly("sigma_s_std_m", [](const Calibration& c) { return std_of(c.sigma_s_m); })
      .def_readonly("sigma_s_upper95_m", &Calibration::sigma_s_upper95_m)
      .def_property_readonly("range_m",
                             [](const Calibration& c) { return std::pair(c.range_min_m, c.range_max_m); })
      .def_readonly("effects", &Calibration::effects)
      .def_readonly("effects_range", &Calibration::effects_range)
      .def_property_readonly("effects_covariance", &effects_covariance)
      .def_property_readonly("effects_covariance_parameters", &effects_covariance_parameters)
      .def_property_readonly("landmark_labels", [](const Calibration& c) { return labels(c.landmarks); })
      .def_property_readonly("landmarks", &landmarks)
      .def_property_readonly("landmark_covariance", &landmark_covariance<&LandmarkEstimate::covariance>)
      .def_property_readonly("landmark_covariance_by_stops",
                             &landmark_covariance<&LandmarkEstimate::covariance_by_stops>)
      .def_property_readonly("landmark_recording",
                             [](const py::object& self) {
                               return field_view(of(self).landmarks, &LandmarkEstimate::recording, self);
                             })
      .def_property_readonly("stop_labels", [](const Calibration& c) { return labels(c.stops); })
      .def_property_readonly("stops", &stops)
      .def_property_readonly(
          "stop_recording",
          [](const py::object& self) { return field_view(of(self).stops, &StopEstimate::recording, self); })
      .def_property_readonly("counts", [](const Calibration& c) { return py::dict(to_dict(c)["counts"]); })
      .def_readonly("joint_nll", &Calibration::joint_nll)
      .def_readonly("nll", &Calibration::marginal_nll)
      .def_readonly("aic", &Calibration::aic)
      .def_readonly("weakest_direction", &Calibration::weakest_direction)
      .def_readonly("iterations", &Calibration::iterations)
      .def_readonly("seconds", &Calibration::seconds)
      .def("f", along_curve([](const CurvePoint& p) { return p.reading_m; }), py::arg("distance_m"))
      .def("f_std", along_curve([](const CurvePoint& p) {
             return p.std_dev_with_choice_m ? *p.std_dev_with_choice_m : p.std_dev_m.value_or(nan);
           }),
           py::arg("distance_m"))
      .def("noise", along_curve([](const CurvePoint& p) { return p.noise_m; }), py::arg("distance_m"))
      .def("to_dict", &to_dict, "The calibration as the dictionary of its file, rangecal-calibration/1.")
      .def(
          "to_json", [](const Calibration& c) { return calibrations_to_json({c}); },
          "The text of its file, rangecal-calibration/1.")
      .def(
          "save",
          [](const Calibration& c, const std::string& path) {
            require_writable(path);
            save_calibrations({c}, path);
          },
          py::arg("path"))
      .def(picklable<Calibration>());

  py::class_<CurveChange>(module, "CurveChange")
      .def_readonly("largest_m", &CurveChange::largest_m)
      .def_readonly("rms_m", &CurveChange::rms_m)
      .def_readonly("chi_sq", &CurveChange::chi_sq)
      .def_readonly("p_value", &CurveChange::p_value)
      .def_readonly("degrees_of_freedom", &CurveChange::degrees_of_freedom)
      .def_readonly("first_taken_as_exact", &CurveChange::first_taken_as_exact)
      .def_readonly("noise_degrees_of_freedom", &CurveChange::noise_degrees_of_freedom)
      .def_readonly("given_the_model", &CurveChange::given_the_model)
      .def_readonly("reason", &CurveChange::reason)
      .def(picklable<CurveChange>());

  module.def(
      "load_calibration",
      [](const std::string& path) { return std::make_shared<Calibration>(load_calibration(path)); },
      py::arg("path"));
  module.def("compare_curves", &compare_curves, py::arg("before"), py::arg("after"));
}

}  // namespace rangecal::python
