// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis_text.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "diagnosis_words.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

constexpr std::size_t width = 96;

std::string where(const Finding& f) {
  std::string text = "  " + wrapped(finding_in_words(f), 4, width) + "\n";
  if (f.residuals.empty()) return text;
  std::vector<double> before, after;
  double limit = 0.0;
  for (const BinnedResidual& b : f.residuals) {
    before.push_back(b.before);
    after.push_back(b.after);
    limit = std::max({limit, std::abs(b.before), std::abs(b.after), 2.0 * b.std_dev});
  }
  const bool noise = f.unit.empty();
  const Shown unit = shown(f.unit);
  const std::string scale =
      noise ? fmt::format("bars: log variance ratio within +-{:.2g}", limit)
            : fmt::format("bars: mean residual within +-{:.2g} {}", unit.factor * limit, unit.unit);
  return text + fmt::format("    before {}   after {}   {}\n", sparkline(before, limit),
                            sparkline(after, limit), scale);
}

std::string table_line(const std::string& name, const std::string& before, const std::string& after,
                       const std::string& note = "") {
  std::string line = fmt::format("  {:<22}{:>12}{:>12}   {}", name, before, after, note);
  line.erase(line.find_last_not_of(' ') + 1);
  return line;
}

std::string before_after(const Diagnosis& d) {
  std::string text = table_line("", "seed model", d.final_effects.empty() ? "" : "completed") + "\n";
  for (const BeforeAfter& row : before_after_rows(d))
    text += table_line(row.name, row.before, row.after, row.note) + "\n";
  if (const std::string blocks = held_out_in_words(d); !blocks.empty())
    text += "  " + wrapped(blocks, 4) + "\n";
  return text;
}

std::string parameters(const Diagnosis& d) {
  std::string text;
  const std::vector<ParameterRow> rows = parameter_rows(d);
  std::size_t widest = 44;
  for (const ParameterRow& row : rows) widest = std::max(widest, row.name.size());
  for (const ParameterRow& row : rows)
    text +=
        fmt::format("  {:<{}} {}{}{}\n", row.name, widest, row.value, row.unit.empty() ? "" : " ", row.unit);
  return text;
}

/// What speaks for each of several names.
std::string names(const Diagnosis& d) {
  const std::vector<MemberRow> rows = member_rows(d);
  if (rows.size() < 2 && d.verdict == Verdict::explained) return "";
  std::size_t widest = 24;
  for (const MemberRow& row : rows) widest = std::max(widest, row.effect.size());
  std::string text;
  const auto add = [&](const std::string& name, const std::string& probability, const std::string& evidence,
                       const std::string& held_out) {
    text += fmt::format("  {:<{}}{:>12}{:>22}{:>22}\n", name, widest, probability, evidence, held_out);
  };
  if (!rows.empty()) add("", "probability", "nats lost without it", "held out");
  for (const MemberRow& row : rows) add(row.effect, row.probability, row.evidence, row.held_out);
  return text;
}

/// Formulas for what has no name.
std::string laws(const Diagnosis& d) {
  std::string text;
  bool first = true;
  for (const LawRow& row : law_rows(d)) {
    text += "  " +
            wrapped(row.formula + (first || !row.agrees ? "" : "  (the same wherever there are readings)"), 4,
                    width) +
            "\n";
    std::string line = row.evidence;
    for (const std::string& parameter : row.parameters) line += "; " + parameter;
    text += "    " + wrapped(line, 6, width) + "\n";
    first = false;
  }
  if (!d.laws.empty() && d.laws.front().log_evidence_over_curve < 0.0)
    text += "  no law is likelier than the free curve\n";
  return text;
}

std::string cannot_tell_apart(const Diagnosis& d) {
  std::string text;
  if (!d.explanations.empty()) {
    const Explanation& best = d.explanations[0];
    for (const auto& set : best.indistinguishable_from)
      text += "  " + wrapped(rivals_in_words(best.effects, set), 4, width) + "\n";
    if (!best.indistinguishable_from.empty() && !best.separated_by.empty())
      text += "    " + wrapped("told apart by: " + best.separated_by, 4, width) + "\n";
  }
  for (const auto& set : d.twins) text += "  " + wrapped(ids_in_words(set, " = "), 4, width) + "\n";
  return text;
}

std::string could_be_hidden(const Diagnosis& d) {
  std::string text;
  constexpr std::size_t most = 8;
  constexpr double next_to_nothing_m = 1e-5;
  std::size_t told = 0;
  for (const Unseen& u : d.unseen) {  // the costliest come first
    if (told == most || u.harm_m < next_to_nothing_m) break;
    ++told;
    std::string line = fmt::format("{} ({}): costs {} mm RMS", id_in_words(u.effect), typical_in_words(u),
                                   millimetres(u.harm_m));
    line += u.detectable ? fmt::format("; would show {}", detectable_in_words(u))
                         : std::string("; no size would show");
    if (!u.settled_by.empty()) line += "; " + u.settled_by;
    text += "  " + wrapped(line, 4, width) + "\n";
  }
  if (d.unseen.size() > told)
    text += told > 0 ? fmt::format("  and {} more (--json lists all)\n", d.unseen.size() - told)
                     : fmt::format("  {} that cost next to nothing (--json lists all)\n", d.unseen.size());
  return text;
}

/// A note on what cannot be judged, which may list most of the catalogue.
std::string with_fewer_ids(const std::string& note) {
  constexpr std::size_t most = 6;
  const std::size_t list = note.rfind(": ");
  if (!note.starts_with("cannot be judged") || list == std::string::npos) return note;
  std::size_t end = list;
  for (std::size_t i = 0; i < most && end != std::string::npos; ++i) end = note.find(", ", end + 1);
  if (end == std::string::npos) return note;
  const auto more = std::count(note.begin() + static_cast<std::ptrdiff_t>(end), note.end(), ',');
  return more < 2 ? note : note.substr(0, end) + fmt::format(" and {} more (--json lists all)", more);
}

std::string do_next(const Diagnosis& d) {
  std::string text;
  for (const NextExperiment& e : d.next_experiments)
    text += "  " +
            wrapped(fmt::format("{} (settles {}; power {:.2f})", e.change, ids_in_words(e.settles, ", "),
                                e.power),
                    4, width) +
            "\n";
  return text;
}

std::string section(const std::string& title, const std::string& body) {
  return body.empty() ? "" : "\n" + title + "\n" + body;
}

}  // namespace

std::string sparkline(const std::vector<double>& values, double limit) {
  static const char* const bars[] = {"▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
  std::string text;
  for (double v : values) {
    const double share = limit > 0.0 && std::isfinite(v) ? 0.5 + 0.5 * v / limit : 0.5;
    text += bars[std::clamp(static_cast<int>(share * 8.0), 0, 7)];
  }
  return text;
}

std::string diagnosis_text(const Diagnosis& d) {
  std::string text =
      wrapped(d.sentence.empty() ? verdict_sentence(d) : d.sentence, 2, width) + "\n\n" + before_after(d);
  std::string places;
  for (const Finding& f : d.location) places += where(f);
  text += section("Where", places);
  if (!d.explanations.empty()) {
    const Explanation& best = d.explanations[0];
    std::string why;
    if (d.verdict == Verdict::explained)
      why = "  " +
            wrapped(fmt::format("{} (probability {:.2f}, {:.1f} nats, {}). {}",
                                ids_in_words(best.effects, " + "), best.probability, d.before.nll - best.nll,
                                p_in_words(best.p_value), best.physics),
                    4, width) +
            "\n";
    text += section("Why", why);
    text += section("Names", names(d));
    text += section("Parameters", parameters(d));
  }
  text += section("Laws for what has no name", laws(d));
  text += section("Cannot tell apart", cannot_tell_apart(d));
  text += section("Could be hidden", could_be_hidden(d));
  text += section("Do next", do_next(d));
  std::string notes;
  for (const std::string& note : d.notes) notes += "  " + wrapped(with_fewer_ids(note), 4, width) + "\n";
  return text + section("Notes", notes);
}

}  // namespace rangecal::app
