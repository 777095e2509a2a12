// SPDX-License-Identifier: BSD-3-Clause
// The proof in small: 60 worlds that are drawn, diagnosed blind and scored as `rangecal prove --fresh` does.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <ostream>

#include "proof/fresh.hpp"
#include "proof/table.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::proof {
namespace {

/// log P(X = k), X binomial of n and p.
double log_binomial(int k, int n, double p) {
  return std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0) + k * std::log(p) +
         (n - k) * std::log1p(-p);
}

/// The largest k with P(X < k) <= 0.001: a program as good as it was measured passes with 99.9 %. The rate is that of
/// `hits` in `measured` worlds by the rule of succession, (hits + 1) / (measured + 2), since no measurement shows 100 %.
int fewest(int worlds, int hits, int measured) {
  const double rate = (hits + 1.0) / (measured + 2.0);
  double below = 0.0;
  for (int k = 0; k <= worlds; ++k) {
    below += std::exp(log_binomial(k, worlds, rate));
    if (below > 0.001) return k;
  }
  return worlds;
}

struct Part {
  const char* row;
  int option;          ///< FreshOptions::worlds; of clean worlds there are 10 / 3 as many
  const char* line;    ///< what the table calls it; lines that begin so are added up
  bool counts_alarms;  ///< the line's figure is the share of failures
  int hits, measured;  ///< by `rangecal prove --fresh N --seed 77 --row ROW`, failures taken off
};

/// How a failing test calls it.
void PrintTo(const Part& part, std::ostream* out) { *out << part.row; }

TEST(Fewest, ByHand) {
  // n = 2, rate (8 + 1) / (8 + 2) = 0.9: P(X < 1) = 0.01 > 0.001, so 0; with rate 99 / 100: P(0) = 1e-4, P(< 2) = 0.0199.
  EXPECT_EQ(fewest(2, 8, 8), 0);
  EXPECT_EQ(fewest(2, 98, 98), 1);
}

class ReducedProof : public ::testing::TestWithParam<Part> {};

TEST_P(ReducedProof, StaysWithinTheMeasuredFigures) {
  const Part& part = GetParam();
  FreshOptions options;
  options.worlds = part.option;
  options.rows = {part.row};
  options.oracle = false;
  options.seed = seed_from("ReducedProof.StaysWithinTheMeasuredFigures");
  const FreshResult result =
      run_fresh(options, [](std::span<const Recording> recordings, const DiagnoseOptions& o) {
        return diagnose(recordings, o);
      });
  int worlds = 0, hits = 0;
  for (const Line& line : proof_lines(result.scores)) {
    if (!line.what.starts_with(part.line)) continue;
    const int counted = static_cast<int>(std::lround(line.figure * line.worlds));
    worlds += line.worlds;
    hits += part.counts_alarms ? line.worlds - counted : counted;
  }
  ASSERT_EQ(worlds, static_cast<int>(result.scores.size()));
  EXPECT_GE(hits, fewest(worlds, part.hits, part.measured))
      << "of " << worlds << ", seed " << options.seed << "\n"
      << proof_text(result.scores, result.out_of_reach);
}

INSTANTIATE_TEST_SUITE_P(Rows, ReducedProof,
                         ::testing::Values(
                             // 20 clean worlds. Measured: 57 of 60 quiet (95 %); bound 14.
                             Part{"clean", 6, "clean, ", true, 57, 60},
                             // 16 worlds. Measured: 47 of 48 (98 %); bound 12.
                             Part{"lambda-100", 16, "lambda 100: right name or twin set", false, 47, 48},
                             // 10 worlds. Measured: 42 of 48 (88 %); bound 5.
                             Part{"noise-50", 10, "noise, tails", false, 42, 48},
                             // 8 worlds. Measured: 28 of 30 (93 %); bound 4.
                             Part{"absorbed", 8, "absorbed twins", false, 28, 30},
                             // 6 worlds. Measured: 27 of 30 (90 %); bound 2.
                             Part{"outside", 6, "outside the catalogue", false, 27, 30}),
                         [](const auto& one) {
                           std::string name = one.param.row;
                           std::erase(name, '-');
                           return name;
                         });

}  // namespace
}  // namespace rangecal::proof
