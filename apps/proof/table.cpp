// SPDX-License-Identifier: BSD-3-Clause
#include "table.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <tuple>

#include "rangecal/core/proportion.hpp"

namespace rangecal::proof {
namespace {

using Condition = std::function<bool(const Score&)>;

bool in_row(const Score& s, std::initializer_list<const char*> rows) {
  return std::any_of(rows.begin(), rows.end(), [&](const char* row) { return s.row == row; });
}

/// A proportion: of worlds, of causes or of names.
void add_counted(std::vector<Line>& lines, const std::string& what, int hits, int all, double required,
                 bool at_most = false) {
  if (all == 0) return;
  Line line{what, fmt::format("{} {:.0f} %", at_most ? "<=" : ">=", 100.0 * required), all,
            static_cast<double>(hits) / all};
  std::tie(line.low, line.high) = wilson(hits, all);
  line.met = at_most ? line.figure <= required + 1e-12 : line.figure >= required - 1e-12;
  lines.push_back(line);
}

/// A proportion over the worlds of some rows that qualify.
void add_share(std::vector<Line>& lines, const std::vector<Score>& scores, const std::string& what,
               const Condition& among, const Condition& hit, double required, bool at_most = false) {
  int worlds = 0, hits = 0;
  for (const Score& s : scores)
    if (among(s)) ++worlds, hits += hit(s);
  add_counted(lines, what, hits, worlds, required, at_most);
}

void add_number(std::vector<Line>& lines, const std::string& what, std::vector<double> values,
                double quantile, double low, double high, const std::string& required) {
  if (values.empty()) return;
  std::sort(values.begin(), values.end());
  const auto at = static_cast<std::size_t>(std::lround(quantile * static_cast<double>(values.size() - 1)));
  Line line{what, required, static_cast<int>(values.size()), values[at], 1.0, 0.0, false, false};
  line.met = line.figure >= low && line.figure <= high;
  lines.push_back(line);
}

std::vector<double> values_of(const std::vector<Score>& scores, const Condition& among,
                              const std::function<std::optional<double>(const Score&)>& value) {
  std::vector<double> out;
  for (const Score& s : scores)
    if (among(s))
      if (const auto v = value(s)) out.push_back(*v);
  return out;
}

Condition row(const std::string& name) {
  return [name](const Score& s) { return s.row == name; };
}

bool right(const Score& s) { return is_right(s.result); }

void add_naming(std::vector<Line>& lines, const std::vector<Score>& scores) {
  const auto wrong = [](const Score& s) { return s.result == Answer::wrong_name; };
  add_share(
      lines, scores, "clean, line: alarm",
      [](const Score& s) { return s.row == "clean" && s.design == "line"; },
      [](const Score& s) { return s.result != Answer::quiet; }, 0.03, true);
  add_share(
      lines, scores, "clean, turning: alarm",
      [](const Score& s) { return s.row == "clean" && s.design == "turning"; },
      [](const Score& s) { return s.result != Answer::quiet; }, 0.03, true);
  add_share(lines, scores, "lambda 100: right name or twin set", row("lambda-100"), right, 0.97);
  add_share(lines, scores, "lambda 50: the same", row("lambda-50"), right, 0.92);
  add_share(lines, scores, "lambda 400: the same", row("lambda-400"), right, 0.98);
  add_share(lines, scores, "lambda 30: the same", row("lambda-30"), right, 0.65);
  add_share(lines, scores, "lambda 30: wrong single name", row("lambda-30"), wrong, 0.05, true);
  add_share(lines, scores, "noise, tails, dependence, labels, grids: 50 nats", row("noise-50"), right, 0.95);
  add_share(
      lines, scores, "lambda 100 or more: wrong single name",
      [](const Score& s) {
        return in_row(s, {"lambda-100", "lambda-400"});
      },
      wrong, 0.02, true);
  add_share(
      lines, scores, "absorbed twins: no alarm, listed", row("absorbed"),
      [](const Score& s) { return s.result == Answer::missed && s.listed.value_or(false); }, 0.99);
  add_share(
      lines, scores, "twins that show: the set", row("twins"),
      [](const Score& s) { return s.result == Answer::right_set; }, 0.99);
  add_share(
      lines, scores, "outside the catalogue: unexplained, located", row("outside"),
      [](const Score& s) { return s.result == Answer::unexplained && s.located; }, 0.92);
  add_share(lines, scores, "two effects: both right", row("pair"), right, 0.85);
  add_share(
      lines, scores, "two effects, others: one right, none wrong",
      [](const Score& s) { return s.row == "pair" && !is_right(s.result); },
      [](const Score& s) { return s.partly_right; }, 0.5);
  add_share(
      lines, scores, "lambda 100: channel and covariate first", row("lambda-100"),
      [](const Score& s) { return s.located; }, 0.92);
}

void add_many(std::vector<Line>& lines, const std::vector<Score>& scores) {
  int named = 0, wrong = 0;
  const double found_wanted[] = {0.96, 0.95, 0.94, 0.93}, all_wanted[] = {0.9, 0.8, 0.7, 0.65};
  for (const char* beside : {"", "-outliers"})
    for (int k = 2; k <= 5; ++k) {
      const std::string name = fmt::format("many-{}{}", k, beside);
      const std::string what = fmt::format("{} causes{}", k, *beside ? ", outliers" : "");
      int found = 0, causes = 0;
      for (const Score& s : scores) {
        if (s.row != name) continue;
        found += s.names.found, causes += s.causes;
        named += s.names.found + s.names.wrong, wrong += s.names.wrong;
      }
      add_counted(lines, what + ": found (causes)", found, causes, found_wanted[k - 2]);
      add_share(lines, scores, what + ": all, and nothing else", row(name), right, all_wanted[k - 2]);
      add_share(
          lines, scores, what + ": the same by single names", row(name),
          [](const Score& s) { return s.result == Answer::right_name; }, 0.0);
    }
  add_share(
      lines, scores, "outliers beside causes: named as one-sided",
      [](const Score& s) { return s.outliers_named.has_value(); },
      [](const Score& s) { return *s.outliers_named; }, 0.9);
  add_share(lines, scores, "outliers on one side: named", row("one-sided"), right, 0.95);
  add_share(
      lines, scores, "everyday tables: all causes, and nothing else", row("everyday"),
      [](const Score& s) { return right(s) || s.result == Answer::quiet; }, 0.92);
  int of_tables = 0, wrong_of_tables = 0;
  for (const Score& s : scores)
    if (s.row == "everyday") of_tables += s.names.found + s.names.wrong, wrong_of_tables += s.names.wrong;
  add_counted(lines, "everyday tables: names of nothing concealed (names)", wrong_of_tables, of_tables, 0.03,
              true);
  add_counted(lines, "several causes: names of nothing concealed (names)", wrong, named, 0.03, true);
}

/// Names of nothing concealed, of all names given in a row.
void add_wrong_names(std::vector<Line>& lines, const std::vector<Score>& scores, const std::string& what,
                     const std::string& of_row, double at_most) {
  int wrong = 0, names = 0;
  for (const Score& s : scores)
    if (s.row == of_row) wrong += s.names.wrong, names += s.names.found + s.names.wrong;
  add_counted(lines, what, wrong, names, at_most, true);
}

/// Rows beyond the catalogue as it is written down: causes against a simulation, beside something unknown, larger than it once
/// looked, of another shape; and recordings in which nothing is the matter but the design or what is stated.
void add_beyond(std::vector<Line>& lines, const std::vector<Score>& scores) {
  int found = 0, causes = 0;
  for (const Score& s : scores)
    if (s.row == "simulation-many-3") found += s.names.found, causes += s.causes;
  add_counted(lines, "simulation, 3 causes: found (causes)", found, causes, 0.93);
  add_share(lines, scores, "simulation, 3 causes: all, and nothing else", row("simulation-many-3"), right,
            0.78);
  add_wrong_names(lines, scores, "simulation, 3 causes: of nothing concealed (names)", "simulation-many-3",
                  0.03);
  add_share(
      lines, scores, "2 causes beside an unknown one: both named", row("beside-unknown"),
      [](const Score& s) { return s.names.found == s.causes; }, 0.85);
  add_share(
      lines, scores, "2 causes beside an unknown one: it is located", row("beside-unknown"),
      [](const Score& s) { return s.located; }, 0.8);
  add_wrong_names(lines, scores, "2 causes beside an unknown one: wrong (names)", "beside-unknown", 0.05);
  add_share(
      lines, scores, "1 to 3 old bounds: named, said to be large", row("large"),
      [](const Score& s) { return right(s) && s.said_large.value_or(false); }, 0.95);
  add_share(lines, scores, "1 to 3 old bounds: named", row("large"), right, 0.0);
  const auto wrong_names = [](const Score& s) { return s.names.wrong > 0; };
  add_share(lines, scores, "formula 10 % off: right name", row("formula-off"), right, 0.92);
  add_share(lines, scores, "formula 10 % off: a wrong name", row("formula-off"), wrong_names, 0.02, true);
  add_share(
      lines, scores, "clean, any design: alarm", row("clean-any"),
      [](const Score& s) { return s.result != Answer::quiet; }, 0.02, true);
  add_share(
      lines, scores, "clean, any design: called unobservable", row("clean-any"),
      [](const Score& s) { return s.answer == "unobservable"; }, 1.0, true);
  add_share(lines, scores, "stated spread off by 2: another name", row("stated-sigma"), wrong_names, 0.03,
            true);
  add_share(
      lines, scores, "stated spread off by 2: another, not stop_effect", row("stated-sigma"),
      [](const Score& s) { return s.names.wrong > 0 && !s.partly_right; }, 0.03, true);
  add_share(
      lines, scores, "stated spread off by 2: named, or not testable", row("stated-sigma"),
      [](const Score& s) { return right(s) || s.result == Answer::quiet; }, 0.0);
}

void add_quality(std::vector<Line>& lines, const std::vector<Score>& scores) {
  const auto has_gain = [](const Score& s) { return s.gain_ratio.has_value(); };
  add_number(lines, "gain over that of the true effect: median",
             values_of(scores, has_gain, [](const Score& s) { return s.gain_ratio; }), 0.5, 0.95, 1.05,
             "0.95 to 1.05");
  add_share(
      lines, scores, "gain more than 8 nats above it", has_gain,
      [](const Score& s) { return *s.gain_excess_nats > 8.0; }, 0.01, true);
  add_share(
      lines, scores, "held-out density improves",
      [](const Score& s) {
        return in_row(s, {"lambda-100", "lambda-400"}) && s.held_out_improves.has_value();
      },
      [](const Score& s) { return *s.held_out_improves; }, 0.99);
  int covered = 0, intervals = 0;
  for (const Score& s : scores) covered += s.coverage.covered, intervals += s.coverage.intervals;
  if (intervals > 0) {
    Line line{"95 % intervals cover (intervals)", "95 % inside", intervals,
              static_cast<double>(covered) / intervals};
    std::tie(line.low, line.high) = wilson(covered, intervals);
    line.met = line.low <= 0.95 && line.high >= 0.95;
    lines.push_back(line);
  }
  add_share(
      lines, scores, "answers of probability 0.9 or more: right",
      [](const Score& s) {
        return in_row(s, {"lambda-30", "lambda-50", "lambda-100", "lambda-400", "noise-50"}) &&
               s.probability >= 0.9 && s.result != Answer::missed && s.result != Answer::unexplained;
      },
      right, 0.88);
  add_share(
      lines, scores, "experiment: shrinks to the truth",
      [](const Score& s) { return s.row == "experiment" && s.experiment_good && s.experiment != "none"; },
      [](const Score& s) { return *s.experiment_good; }, 0.9);
  add_share(
      lines, scores, "experiment: nothing separates, and said so",
      [](const Score& s) { return s.row == "experiment" && s.experiment_good && s.experiment == "none"; },
      [](const Score& s) { return *s.experiment_good; }, 0.9);
  double level = 0.97;
  for (const Line& line : lines)
    if (line.what == "lambda 100: right name or twin set") level = line.figure;
  add_share(lines, scores, "against a simulation: right (3 points of the row)", row("simulation-effect"),
            right, std::max(0.0, level - 0.03));
  add_share(
      lines, scores, "simulation alike: alarm", row("simulation-alike"),
      [](const Score& s) { return s.result != Answer::quiet; }, 0.03, true);
  add_share(lines, scores, "only alpha differs: named", row("simulation-alpha"), right, 0.97);
  add_share(
      lines, scores, "closed loop: no mismatch", row("closed-loop"),
      [](const Score& s) { return s.result == Answer::quiet; }, 0.9);
  const auto seconds =
      values_of(scores, row("speed"), [](const Score& s) { return std::optional(s.seconds); });
  add_number(lines, "1500 readings: seconds, median", seconds, 0.5, 0.0, 1.0, "<= 1 s");
  add_number(lines, "1500 readings: seconds, worst", seconds, 1.0, 0.0, 2.0, "<= 2 s");
}

bool is_miss(const Score& s) {
  if (in_row(s, {"clean", "clean-any", "simulation-alike", "closed-loop"})) return s.result != Answer::quiet;
  if (s.row == "stated-sigma") return !is_right(s.result) && s.result != Answer::quiet;
  if (s.row == "large") return !is_right(s.result) || !s.said_large.value_or(false);
  if (s.row == "absorbed") return s.result != Answer::missed || !s.listed.value_or(false);
  if (s.row == "twins") return s.result != Answer::right_set;
  if (s.row == "outside") return s.result != Answer::unexplained || !s.located;
  if (s.row == "everyday") return !is_right(s.result) && s.result != Answer::quiet;
  if (s.row == "experiment") return s.experiment_good.has_value() && !*s.experiment_good;
  return !is_right(s.result);
}

/// Planted effect -> answers with counts, most frequent first.
std::string tally(const std::vector<Score>& scores, const Condition& among, bool by_row) {
  std::map<std::string, std::map<std::string, int>> counts;
  for (const Score& s : scores)
    if (among(s)) ++counts[by_row ? s.row : s.planted][by_row ? s.planted + " -> " + s.answer : s.answer];
  std::string out;
  for (const auto& [key, answers] : counts) {
    std::vector<std::pair<int, std::string>> order;
    for (const auto& [answer, count] : answers) order.emplace_back(-count, answer);
    std::sort(order.begin(), order.end());
    std::string text;
    for (std::size_t i = 0; i < order.size() && i < 12; ++i)
      text += fmt::format("{}{} x{}", i > 0 ? ", " : "", order[i].second, -order[i].first);
    if (order.size() > 12) text += fmt::format(", {} more", order.size() - 12);
    out += fmt::format("  {:<22} {}\n", key, text);
  }
  return out;
}

}  // namespace

std::vector<Line> proof_lines(const std::vector<Score>& scores) {
  std::vector<Line> lines;
  add_naming(lines, scores);
  add_many(lines, scores);
  add_beyond(lines, scores);
  add_quality(lines, scores);
  return lines;
}

std::string proof_text(const std::vector<Score>& scores, const std::map<std::string, int>& out_of_reach) {
  std::string out = fmt::format("{:<50} {:>7} {:>9}  {:<17} {:<14}\n", "what", "worlds", "figure",
                                "95 % interval", "at least");
  for (const Line& line : proof_lines(scores)) {
    const std::string figure =
        line.percent ? fmt::format("{:.1f} %", 100.0 * line.figure) : fmt::format("{:.3f}", line.figure);
    const std::string interval = line.low <= line.high
                                     ? fmt::format("{:.1f} to {:.1f} %", 100.0 * line.low, 100.0 * line.high)
                                     : std::string("-");
    out += fmt::format("{:<50} {:>7} {:>9}  {:<17} {:<14} {}\n", line.what, line.worlds, figure, interval,
                       line.required, line.met ? "met" : "NOT MET");
  }
  int sets = 0, named = 0, single = 0, errors = 0;
  double clean = 0.0, slowest = 0.0;
  for (const Score& s : scores) {
    errors += !s.error.empty();
    slowest = std::max(slowest, s.seconds);
    if (in_row(s, {"clean", "clean-any"})) clean = std::max(clean, s.value);
    if (s.planted == "clean" || s.answer == "no_mismatch" || s.answer == "generic") continue;
    ++named, sets += s.set_size, single += s.set_size == 1;
  }
  if (named > 0)
    out += fmt::format("\nnamed: {}, single names: {}, mean set size {:.2f}\n", named, single,
                       static_cast<double>(sets) / named);
  const auto seconds = values_of(
      scores, [](const Score&) { return true; }, [](const Score& s) { return std::optional(s.seconds); });
  if (!seconds.empty()) {
    std::vector<double> order = seconds;
    std::sort(order.begin(), order.end());
    out += fmt::format("seconds a world, several at once: median {:.2f}, worst {:.2f}\n",
                       order[order.size() / 2], slowest);
  }
  out += fmt::format("largest noncentrality of a clean world: {:.2g}\n", clean);
  if (errors > 0) out += fmt::format("worlds on which the diagnosis threw: {}\n", errors);
  if (!out_of_reach.empty()) {
    out += "drawn, but out of reach within a physical size:";
    for (const auto& [what, count] : out_of_reach) out += fmt::format(" {} x{};", what, count);
    out += "\n";
  }
  out += "\nmisses by row (planted -> answer):\n" + tally(scores, is_miss, true);
  out += "\nplanted -> answers:\n" + tally(
                                         scores, [](const Score& s) { return s.row != "clean"; }, false);
  return out;
}

}  // namespace rangecal::proof
