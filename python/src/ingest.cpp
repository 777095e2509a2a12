// SPDX-License-Identifier: BSD-3-Clause
#include <locale.h>
#include <pybind11/stl.h>

#include "columns.hpp"
#include "ingest/bags/bag_correction.hpp"
#include "ingest/bags/message_source.hpp"
#include "ingest/extract_options.hpp"
#include "ingest/importer.hpp"
#include "module.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "work.hpp"

namespace rangecal::python {
namespace {

/// Numbers with a decimal point for the C library on this thread, whatever locale the program has set: CLI11 reads by it.
class PlainNumbers {
 public:
  PlainNumbers()
      : plain_(::newlocale(LC_NUMERIC_MASK, "C", ::duplocale(::uselocale(nullptr)))),
        before_(::uselocale(plain_)) {}
  PlainNumbers(const PlainNumbers&) = delete;
  PlainNumbers& operator=(const PlainNumbers&) = delete;
  ~PlainNumbers() {
    ::uselocale(before_);
    ::freelocale(plain_);
  }

 private:
  locale_t plain_, before_;
};

/// The options of a command from words as its command line has them, then its work, interruptibly.
template <typename Result>
Result run_command(const std::function<std::function<Result()>(CLI::App&)>& declare, const std::string& name,
                   const std::vector<std::string>& words) {
  CLI::App command{name};
  const std::function<Result()> work = declare(command);
  try {
    const PlainNumbers plain;
    command.parse(std::vector<std::string>(words.rbegin(), words.rend()));
  } catch (const CLI::ParseError& error) {
    throw InputError(name + ": " + error.what());
  }
  return run_interruptible<Result>([work](const StageHook&) { return work(); }, py::none());
}

void warn(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings)  // 2: of the line that calls rangecal.extract or an importer
    py::module_::import("warnings").attr("warn")(warning, py::none(), 2);
}

py::tuple extract_job(const std::vector<std::string>& words) {
  const auto declare = [](CLI::App& command) { return ingest::add_extract_options(command); };
  const auto found = run_command<ingest::Extracted>(declare, "extract", words);
  const Extraction& extraction = found.extraction;
  warn(found.warnings);
  return py::make_tuple(std::make_shared<Recording>(extraction.recording),
                        ingest::extraction_json(extraction, found.options),
                        ingest::describe(extraction, found.options));
}

py::tuple import_job(const std::string& name, const std::vector<std::string>& words) {
  std::string known;
  for (const ingest::Importer& importer : ingest::importers()) {
    known += (known.empty() ? "" : ", ") + importer.name;
    if (importer.name != name) continue;
    const auto got = run_command<ingest::Imported>(importer.add, "import " + name, words);
    warn(got.warnings);
    return py::make_tuple(std::make_shared<Recording>(got.recording), got.extraction_json, got.words);
  }
  throw InputError("no importer is called '" + name + "'; known: " + known);
}

py::dict correct_bag(const Calibration& calibration, const std::string& name, const std::string& in,
                     const std::string& out, const std::string& topic, const std::string& keep_raw,
                     bool clockwise, const py::object& progress) {
  require_apart({out}, {in});
  require_place_for_file(out);
  const auto found = run_interruptible<ingest::BagCorrected>(
      [=](const StageHook& hook) {
        return ingest::correct_bag(
            calibration, name, in, out,
            {.topic = topic, .keep_raw = keep_raw, .clockwise = clockwise, .progress = [&](double share) {
               hook("correct", share);
             }});
      },
      progress);
  if (!found.warning.empty()) warn({found.warning});
  py::dict result;
  result["topic"] = found.topic;
  result["type"] = found.type;
  result["format"] = found.format;
  result["messages"] = found.messages;
  result["left_out"] = found.left_out;
  result["readings"] = found.readings;
  result["corrected"] = found.corrected;
  result["kept"] = found.kept;
  result["without_distance"] = found.without_distance;
  result["ambiguous"] = found.ambiguous;
  result["out_of_range"] = found.out_of_range;
  result["extrapolated"] = found.extrapolated;
  result["extrapolated_column"] = found.extrapolated_column;
  return result;
}

}  // namespace

void bind_ingest(py::module_& module) {
  module.def("correct_bag", &correct_bag);
  module.def("is_bag", &ingest::is_bag);
  module.def("extract_job", &extract_job);
  module.def("import_job", &import_job);
  module.def("csv_text", &csv_text);
}

}  // namespace rangecal::python
