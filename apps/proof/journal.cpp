// SPDX-License-Identifier: BSD-3-Clause
#include "journal.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::proof {
namespace {

std::string header() {
  return "row,design,index,seed,planted,size,lambda_or_nats,answer,class,set_size,probability,alarm_p,"
         "location,located,"
         "gain_ratio,gain_excess_nats,covered,intervals,held_out_improves,listed,experiment,experiment_good,"
         "seconds,"
         "partly_right,causes,found,wrong_names,outliers_named,said_large,outside,names,error\n";
}

std::string line(const Score& s) {
  const auto number = [](const std::optional<double>& v) {
    return v ? fmt::format("{:.6g}", *v) : std::string();
  };
  const auto flag = [](const std::optional<bool>& v) {
    return v ? std::string(*v ? "1" : "0") : std::string();
  };
  return fmt::format(
      "{},{},{},{},{},{:.6g},{:.6g},{},{},{},{:.4f},{:.4g},{},{},{},{},{},{},{},{},{},{},{:.3f},{:d},{},{},{},{},{},{},{},{}\n",
      s.row, s.design, s.index, s.seed, s.planted, s.size, s.value, s.answer, to_string(s.result), s.set_size,
      s.probability, s.alarm_p, s.location, s.located ? 1 : 0, number(s.gain_ratio),
      number(s.gain_excess_nats), s.coverage.covered, s.coverage.intervals, flag(s.held_out_improves),
      flag(s.listed), s.experiment, flag(s.experiment_good), s.seconds, s.partly_right, s.causes,
      s.names.found, s.names.wrong, flag(s.outliers_named), flag(s.said_large), csv_field(s.coverage.outside),
      s.probabilities, csv_field(s.error));
}

Answer answer_of(const CsvTable& table, std::size_t row, std::size_t column) {
  for (const Answer answer : {Answer::quiet, Answer::false_alarm, Answer::right_name, Answer::right_set,
                              Answer::wrong_name, Answer::wrong_set, Answer::missed, Answer::unexplained})
    if (table.text(row, column) == to_string(answer)) return answer;
  table.fail(row, column, "is no class of answers");
}

std::uint64_t seed_of(const CsvTable& table, std::size_t row, std::size_t column) {
  const std::string_view text = table.text(row, column);
  std::uint64_t seed = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
  if (error != std::errc() || end != text.data() + text.size()) table.fail(row, column, "is no seed");
  return seed;
}

}  // namespace

std::string proof_csv(const std::vector<Score>& scores) {
  std::string out = header();
  for (const Score& score : scores) out += line(score);
  return out;
}

std::vector<Score> read_scores(std::string text, const std::string& name) {
  text.resize(text.rfind('\n') == std::string::npos ? 0 : text.rfind('\n') + 1);
  if (text.empty()) return {};
  const CsvTable t = CsvTable::parse(text, name);
  const auto column = [&](const char* of) { return t.require(of); };
  const auto flag = [&](std::size_t row, const char* of) -> std::optional<bool> {
    const std::optional<double> value = t.number(row, column(of));
    return value ? std::optional<bool>(*value != 0.0) : std::nullopt;
  };
  const auto words = [&](std::size_t row, const char* of) { return std::string(t.text(row, column(of))); };
  std::vector<Score> scores(t.rows());
  for (std::size_t i = 0; i < t.rows(); ++i) {
    Score& s = scores[i];
    s.row = words(i, "row"), s.design = words(i, "design"), s.index = t.count(i, column("index"));
    s.seed = seed_of(t, i, column("seed"));
    s.planted = words(i, "planted"), s.answer = words(i, "answer");
    s.size = t.finite(i, column("size")), s.value = t.finite(i, column("lambda_or_nats"));
    s.result = answer_of(t, i, column("class"));
    s.set_size = t.count(i, column("set_size"));
    s.probability = t.finite(i, column("probability")), s.alarm_p = t.finite(i, column("alarm_p"));
    s.location = words(i, "location"), s.located = flag(i, "located").value_or(false);
    s.gain_ratio = t.number(i, column("gain_ratio")),
    s.gain_excess_nats = t.number(i, column("gain_excess_nats"));
    s.coverage = {t.count(i, column("covered")), t.count(i, column("intervals")), words(i, "outside")};
    s.held_out_improves = flag(i, "held_out_improves"), s.listed = flag(i, "listed");
    s.experiment = words(i, "experiment"), s.experiment_good = flag(i, "experiment_good");
    s.seconds = t.finite(i, column("seconds")), s.partly_right = flag(i, "partly_right").value_or(false);
    s.causes = t.count(i, column("causes"));
    s.names = {t.count(i, column("found")), t.count(i, column("wrong_names"))};
    s.outliers_named = flag(i, "outliers_named");
    if (t.find("said_large")) s.said_large = flag(i, "said_large");  // not in files of before the row `large`
    if (t.find("names")) s.probabilities = words(i, "names");
    s.error = words(i, "error");
  }
  return scores;
}

Journal::Journal(const std::string& path, const std::vector<Score>& known) : path_(path) {
  write_file(path, proof_csv(known));
  file_ = Descriptor(::open(path.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC));
  if (!file_) throw InputError(path, 0, "", std::string("cannot be written: ") + std::strerror(errno));
}

void Journal::append(const Score& score) {
  const std::string text = line(score);
  const off_t before = ::lseek(file_.number(), 0, SEEK_END);
  const int error = write_all(file_.number(), text);
  if (error == 0) return;
  const std::string reason = std::strerror(error);
  if (before < 0 || ::ftruncate(file_.number(), before) != 0)
    throw InputError(path_, 0, "", "ends in a torn line: " + reason);
  throw InputError(path_, 0, "", "cannot be written: " + reason);
}

void Journal::finish(const std::vector<Score>& scores) { write_file(path_, proof_csv(scores)); }

}  // namespace rangecal::proof
