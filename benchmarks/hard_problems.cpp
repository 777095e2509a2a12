// SPDX-License-Identifier: BSD-3-Clause
// Joint problems that are hard in twenty ways (hard/worlds.hpp), solved by `full` and `marginal`, and every
// answer checked from outside (hard/judge.hpp): numbers finite, a converged answer where its likelihood's
// gradient vanishes and no worse than its seed, by NLopt too for every `sample`-th world; any other outcome
// with its reason, unobservable with its direction. One line per answer goes to the CSV as it is found;
// worlds that the file holds already are not run again.
//
//   hard_problems COUNT [CSV] [THREADS] [SAMPLE] [FIRST]
//
// Exit code 1 where an answer is not what it says it is.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <map>
#include <mutex>
#include <set>
#include <sstream>

#include "hard/judge.hpp"
#include "threads.hpp"

namespace {

using namespace rangecal;
using namespace rangecal::hard;

const char* const outcomes[] = {"converged",     "unobservable", "unbounded", "too_few_data",
                                "not_converged", "failed",       "refused"};

struct Row {
  int kind = 0;
  bool checked = false, better = false;
  Judgement judgement;
};

std::string quoted(std::string text) {
  for (std::size_t at = 0; (at = text.find('"', at)) != std::string::npos; at += 2) text.insert(at, 1, '"');
  return '"' + text + '"';
}

std::string csv_line(const World& world, const Judgement& j) {
  return fmt::format("{},{},{},{},{},{},{},{},{},{},{:.4f},{},{}\n", world.id, world.kinds[0],
                     world.kinds.size(), to_string(j.method), j.outcome, j.nll, j.seed_nll, j.better_nll,
                     j.gradient, j.iterations, j.seconds, quoted(j.violation), quoted(j.reason));
}

/// Text fields hold no line breaks and come last: what is before them can be cut at the commas.
std::map<std::uint64_t, std::vector<Row>> read_rows(const std::string& path) {
  std::map<std::uint64_t, std::vector<Row>> rows;
  std::ifstream file(path);
  std::string line;
  while (std::getline(file, line)) {
    std::stringstream fields(line);
    std::vector<std::string> f(11);
    for (std::string& field : f) std::getline(fields, field, ',');
    if (f[10].empty() || f[0] == "world" || line.back() != '"') continue;
    Row row;
    row.kind = std::stoi(f[1]);
    row.judgement.method = method_from_string(f[3]);
    row.judgement.outcome = f[4];
    row.judgement.nll = std::stod(f[5]);
    row.judgement.better_nll = std::stod(f[7]);
    row.judgement.gradient = std::stod(f[8]);
    row.judgement.iterations = std::stoi(f[9]);
    row.judgement.seconds = std::stod(f[10]);
    std::string rest;
    std::getline(fields, rest);
    row.judgement.violation = rest.substr(1, rest.find("\",") - 1);
    row.checked = !std::isnan(row.judgement.better_nll);
    row.better = row.judgement.method == Method::full && row.judgement.better_nll < row.judgement.nll - 1e-6;
    rows[std::stoull(f[0])].push_back(row);
  }
  std::erase_if(rows, [](const auto& world) { return world.second.size() != 2; });
  return rows;
}

void print_table(const std::vector<Row>& rows, Method method) {
  std::printf("%-22s %9s", to_string(method), "worlds");
  for (const char* outcome : outcomes) std::printf(" %13s", outcome);
  std::printf(" %11s\n", "violations");
  std::map<std::string, int> all;
  const auto line = [&](const char* name, const std::map<std::string, int>& count) {
    const auto of = [&](const char* what) { return count.count(what) ? count.at(what) : 0; };
    std::printf("%-22s %9d", name, of("worlds"));
    for (const char* outcome : outcomes) std::printf(" %13d", of(outcome));
    std::printf(" %11d\n", of("violations"));
  };
  double gradient = 0.0, seconds = 0.0;
  int iterations = 0, checked = 0, better = 0, rough = 0;
  for (std::size_t kind = 0; kind < kinds.size(); ++kind) {
    std::map<std::string, int> count;
    for (const Row& row : rows) {
      const Judgement& j = row.judgement;
      if (row.kind != static_cast<int>(kind) || j.method != method) continue;
      for (auto* sum : {&count, &all}) {
        ++(*sum)["worlds"];
        ++(*sum)[j.outcome];
        if (!j.violation.empty()) ++(*sum)["violations"];
      }
      if (j.violation.empty() && j.outcome == "converged") {
        gradient = std::max(gradient, j.gradient);
        rough += j.gradient > 1e-4;
      }
      seconds = std::max(seconds, j.seconds);
      iterations = std::max(iterations, j.iterations);
      checked += row.checked;
      better += row.better;
    }
    line(kinds[kind].name, count);
  }
  line("all", all);
  std::printf(
      "converged answers: farthest from its optimum %.1e standard deviations, %d beyond 1e-4; at most %d "
      "iterations, %.2f s\n",
      gradient, rough, iterations, seconds);
  std::printf("NLopt asked %d times", checked);
  if (method == Method::full) std::printf("; it found another basin, lower, %d times", better);
  std::printf("\n\n");
}

}  // namespace

int main(int count, char** arguments) {
  const auto argument = [&](int i, long otherwise) {
    return count > i ? std::atol(arguments[i]) : otherwise;
  };
  const long worlds = argument(1, 400), threads = argument(3, 0), sample = argument(4, 20),
             first = argument(5, 0);
  const std::string path = count > 2 ? arguments[2] : "";
  std::map<std::uint64_t, std::vector<Row>> known;
  if (!path.empty()) known = read_rows(path);
  std::ofstream file;
  if (!path.empty()) {
    const bool begins = known.empty();
    file.open(path, begins ? std::ios::trunc : std::ios::app);
    if (begins)
      file << "world,kind,kinds,method,outcome,nll,seed_nll,nlopt_nll,gradient,iterations,seconds,violation,"
              "reason\n";
  }
  const tbb::global_control limit = at_most(threads);
  std::mutex mutex;
  tbb::parallel_for(first, first + worlds, [&](long id) {
    const auto key = static_cast<std::uint64_t>(id);
    {
      const std::lock_guard lock(mutex);
      if (known.count(key)) return;
    }
    const World world = make_world(key);
    // Kinds go round with the numbers: a sample of every kind.
    const std::vector<Judgement> judgements =
        judge(world, (id / static_cast<long>(kinds.size())) % sample == 0);
    const std::lock_guard lock(mutex);
    std::vector<Row>& rows = known[key];
    for (const Judgement& j : judgements) {
      Row row{world.kinds[0], !std::isnan(j.better_nll),
              j.method == Method::full && j.better_nll < j.nll - 1e-6, j};
      rows.push_back(row);
      if (file.is_open()) file << csv_line(world, j);
      if (!j.violation.empty())
        std::fprintf(stderr, "world %ld (%s), %s, %s: %s\n", id, kinds[world.kinds[0]].name,
                     to_string(j.method), j.outcome.c_str(), j.violation.c_str());
    }
    file.flush();
  });
  std::vector<Row> rows;
  int violations = 0;
  for (long id = first; id < first + worlds; ++id)
    for (const Row& row : known[static_cast<std::uint64_t>(id)]) {
      rows.push_back(row);
      violations += !row.judgement.violation.empty();
    }
  print_table(rows, Method::full);
  print_table(rows, Method::marginal);
  return violations > 0;
}
