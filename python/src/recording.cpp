// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <cmath>

#include "archive_fields.hpp"
#include "arrays.hpp"
#include "columns.hpp"
#include "module.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/recording_io.hpp"
#include "work.hpp"

namespace rangecal::python {

Recordings::Recordings(std::vector<std::shared_ptr<const Recording>> recordings) {
  if (recordings.empty()) throw InputError("no recording is given");
  for (const auto& recording : recordings)
    if (!recording) throw py::type_error("None is not a Recording");
  if (recordings.size() == 1) {
    one_ = recordings.front();
    return;
  }
  std::vector<Recording> copies;
  for (const auto& recording : recordings) copies.push_back(*recording);
  several_ = std::make_shared<const std::vector<Recording>>(std::move(copies));
}

std::span<const Recording> Recordings::span() const {
  if (one_) return {one_.get(), 1};
  return *several_;
}

namespace {

bool is_pairs(const Recording& r) { return r.kind == RecordingKind::pairs; }

/// A getter of a view on one column: of the readings, or of the pairs.
template <typename T>
auto column(std::vector<T> Readings::*of_readings, std::vector<T> Pairs::*of_pairs) {
  return [=](const py::object& self) -> py::object {
    const auto& r = self.cast<const Recording&>();
    if (is_pairs(r) ? of_pairs == nullptr : of_readings == nullptr) return py::none();
    const std::vector<T>& values = is_pairs(r) ? r.pairs.*of_pairs : r.readings.*of_readings;
    const bool absent = values.empty() && (is_pairs(r) ? r.pairs.size() : r.readings.size()) > 0;
    return absent ? py::object(py::none()) : py::object(view(values, self));
  };
}

template <typename Items, typename Get>
std::vector<std::string> labels(const Items& items, Get get) {
  std::vector<std::string> texts;
  for (const auto& item : items) texts.push_back(get(item));
  return texts;
}

/// (n, 3) of poses, NaN where one is not known; None where none is.
py::object true_stops(const Recording& r) {
  if (r.truth.stops.empty()) return py::none();
  py::array_t<double> array({static_cast<py::ssize_t>(r.truth.stops.size()), py::ssize_t{3}});
  auto at = array.mutable_unchecked<2>();
  for (std::size_t i = 0; i < r.truth.stops.size(); ++i) {
    const Pose2 pose = r.truth.stops[i].value_or(Pose2{nan, nan, nan});
    const auto row = static_cast<py::ssize_t>(i);
    at(row, 0) = pose.x_m, at(row, 1) = pose.y_m, at(row, 2) = pose.heading_rad;
  }
  return array;
}

/// (n, 2), the same of landmarks.
py::object true_landmarks(const Recording& r) {
  if (r.truth.landmarks.empty()) return py::none();
  py::array_t<double> array({static_cast<py::ssize_t>(r.truth.landmarks.size()), py::ssize_t{2}});
  auto at = array.mutable_unchecked<2>();
  for (std::size_t i = 0; i < r.truth.landmarks.size(); ++i)
    for (py::ssize_t k = 0; k < 2; ++k)
      at(static_cast<py::ssize_t>(i), k) = r.truth.landmarks[i] ? (*r.truth.landmarks[i])[k] : nan;
  return array;
}

py::dict covariates(const py::object& self) {
  const auto& r = self.cast<const Recording&>();
  py::dict views;
  for (const auto& [name, values] : is_pairs(r) ? r.pairs.covariates : r.readings.covariates)
    views[py::str(name)] = view(values, self);
  return views;
}

py::dict counts(const Counts& c) {
  py::dict dropped;
  for (const auto& [reason, count] : c.dropped) dropped[py::str(reason)] = count;
  py::dict dict;
  dict["read"] = c.read;
  dict["used"] = c.used;
  dict["dropped"] = dropped;
  dict["cells_left_out"] = c.cells_left_out;
  return dict;
}

/// False for what a debugger shows of a constructor that threw: there is no memory behind it to look at.
bool is_made(const py::handle& self) {
  return reinterpret_cast<py::detail::instance*>(self.ptr())->get_value_and_holder().holder_constructed();
}

py::object groups_of(const py::object& self) {
  const auto& r = self.cast<const Recording&>();
  return r.groups.stated() ? py::object(view(r.groups.of, self)) : py::object(py::none());
}

std::shared_ptr<Recording> parse(const std::string& header, const py::dict& tables) {
  std::map<std::string, std::string> files{{"recording.yaml", header}};
  for (const auto& [name, columns] : tables) {
    const std::string file = py::str(name);
    files[file] = csv_text(columns.cast<py::dict>(), file);
  }
  return std::make_shared<Recording>(parse_recording(files));
}

}  // namespace

void bind_recording(py::module_& module) {
  py::class_<Sensor>(module, "Sensor")
      .def_readonly("name", &Sensor::name)
      .def_readonly("principle", &Sensor::principle)
      .def_readonly("range_min_m", &Sensor::range_min_m)
      .def_readonly("range_max_m", &Sensor::range_max_m)
      .def_readonly("unit", &Sensor::unit)
      .def(picklable<Sensor>());

  py::class_<Recording, std::shared_ptr<Recording>>(module, "Recording", py::dynamic_attr())
      .def(py::init(&parse), py::arg("header"), py::arg("tables"))
      .def_readonly("path", &Recording::path)
      .def_property_readonly("kind", [](const Recording& r) { return is_pairs(r) ? "pairs" : "landmarks"; })
      .def_readonly("sensor", &Recording::sensor)
      .def_property_readonly("sigma_xy_m",
                             [](const Recording& r) {
                               return r.estimate_sigma_xy ? py::object(py::str("estimate"))
                                                          : py::object(py::float_(r.sigma_xy_m));
                             })
      .def_readonly("sigma_heading_rad", &Recording::sigma_heading_rad)
      .def_property_readonly("stop_error",
                             [](const Recording& r) {
                               return r.stop_error == StopErrorModel::random_walk ? "random_walk"
                                                                                  : "independent";
                             })
      .def_property_readonly("counts", [](const Recording& r) { return counts(r.counts); })
      .def_readonly("extraction", &Recording::extraction)
      .def_property_readonly("notes", [](const Recording& r) { return r.notes; })
      .def_property_readonly(
          "stop_labels",
          [](const Recording& r) { return labels(r.stops, [](const Stop& s) { return s.label; }); })
      .def_property_readonly(
          "places", [](const Recording& r) { return labels(r.stops, [](const Stop& s) { return s.place; }); })
      .def_property_readonly("stops",
                             [](const py::object& self) {
                               return field_view(
                                   self.cast<const Recording&>().stops,
                                   self.cast<const Recording&>().stops.empty()
                                       ? nullptr
                                       : &self.cast<const Recording&>().stops.front().commanded.x_m,
                                   3, self);
                             })
      .def_property_readonly(
          "landmark_labels",
          [](const Recording& r) { return labels(r.landmarks, [](const Landmark& l) { return l.label; }); })
      .def_property_readonly("landmark_radius_m",
                             [](const py::object& self) {
                               return field_view(self.cast<const Recording&>().landmarks, &Landmark::radius_m,
                                                 self);
                             })
      .def_property_readonly("true_stops", &true_stops)
      .def_property_readonly("true_landmarks", &true_landmarks)
      .def_property_readonly("stop", column<int>(&Readings::stop, nullptr))
      .def_property_readonly("landmark", column<int>(&Readings::landmark, &Pairs::landmark))
      .def_property_readonly("repeat", column<int>(&Readings::repeat, nullptr))
      .def_property_readonly("batch", column<int>(nullptr, &Pairs::batch))
      .def_property_readonly("batch_labels", [](const Recording& r) { return r.pairs.batch_labels; })
      .def_property_readonly("group_by", [](const Recording& r) { return r.groups.by; })
      .def_property_readonly("group", &groups_of)
      .def_property_readonly("group_labels", [](const Recording& r) { return r.groups.labels; })
      .def_property_readonly("reference_sigma_m", [](const Recording& r) { return r.reference.sigma_m; })
      .def_property_readonly("time_s", column<double>(&Readings::time_s, &Pairs::time_s))
      .def_property_readonly("range_m", column<double>(&Readings::range_m, &Pairs::reading_m))
      .def_property_readonly("true_m", column<double>(nullptr, &Pairs::true_m))
      .def_property_readonly("bearing_rad", column<double>(&Readings::bearing_rad, &Pairs::bearing_rad))
      .def_property_readonly("row", column<int>(&Readings::row, &Pairs::row))
      .def_property_readonly("covariates", &covariates)
      .def(
          "save",
          [](const Recording& recording, const std::string& folder, const std::string& maker,
             bool overwrite) {
            if (!overwrite) require_replaceable(folder);
            save_recording(recording, folder, maker);
          },
          py::arg("folder"), py::arg("maker"), py::arg("overwrite"), py::call_guard<py::gil_scoped_release>())
      .def("__len__", [](const Recording& r) { return is_pairs(r) ? r.pairs.size() : r.readings.size(); })
      .def(picklable<Recording>());

  module.def("is_made", &is_made, py::arg("recording").none(false));
  module.def(
      "load_recording",
      [](const std::string& folder, const std::vector<std::string>& group_by) {
        return run_interruptible<std::shared_ptr<Recording>>(
            [folder, group_by](const StageHook&) {
              return std::make_shared<Recording>(load_recording(folder, {group_by}));
            },
            py::none());
      },
      py::arg("folder"), py::arg("group_by"));
}

}  // namespace rangecal::python
