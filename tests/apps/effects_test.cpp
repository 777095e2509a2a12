// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "apps/run_binary.hpp"
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::test {
namespace {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

/// The comment at the head of a source file as one line, without the licence.
std::string head_of(const std::string& source) {
  std::string head;
  std::size_t at = source.find('\n') + 1;
  while (source.compare(at, 2, "//") == 0) {
    const std::size_t end = source.find('\n', at);
    std::string line = source.substr(at + 2, end - at - 2);
    if (!head.empty() && !line.empty() && line.front() != ' ') line = " " + line;
    head += head.empty() && !line.empty() ? line.substr(1) : line;
    at = end + 1;
  }
  return head;
}

TEST(EffectsCommand, ListsAllOrOne) {
  const RunResult all = run("effects"), one = run("effects tilt"), none = run("effects nothing");
  EXPECT_EQ(all.code, 0);
  EXPECT_THAT(all.out, AllOf(HasSubstr("range_eccentricity"), HasSubstr("wheel_slip"), HasSubstr("typical")));
  EXPECT_THAT(one.out, AllOf(HasSubstr("formula"), HasSubstr("parameter"), HasSubstr("source"),
                             Not(HasSubstr("wheel_slip"))));
  EXPECT_EQ(none.code, 2);
}

TEST(EffectsCommand, SaysTheSameWhereverAnEffectShows) {
  const RunResult all = run("effects"), one = run("effects range_offset");
  EXPECT_THAT(all.out,
              AllOf(HasSubstr("\nrange_offset  (range)\n"), HasSubstr("\ncell_effect  (range_dependence)\n"),
                    HasSubstr("\ntilt  (range along sensor_bearing)\n")));
  EXPECT_THAT(one.out, HasSubstr("shows in   range\n"));
  EXPECT_THAT(run("effects tilt").out, HasSubstr("shows in   range along sensor_bearing\n"));
}

TEST(EffectsCommand, ParametersThatNoFitMovesHaveUnitsAndWordsOfTheirOwn) {
  const std::string page = run("effects --markdown").out;
  EXPECT_THAT(page, AllOf(HasSubstr("| `direction_rad` | rad | chosen from the recording | | |\n"),
                          HasSubstr("| `half_width_rad` | rad | chosen from the recording | | |\n"),
                          HasSubstr("| `limit_m` | m | chosen from the recording | | |\n"),
                          HasSubstr("| `cv_per_m` | 1/m | that of the fitted noise | | |\n")));
  EXPECT_THAT(run("effects reciprocal_noise").out, AllOf(HasSubstr("cv_per_m: that of the fitted noise\n"),
                                                         Not(HasSubstr("chosen from the recording"))));
}

TEST(EffectsCommand, TheCatalogueInTheDocumentsIsWhatTheProgramPrints) {  // make catalogue
  const RunResult printed = run("effects --markdown");
  EXPECT_EQ(printed.code, 0);
  EXPECT_EQ(printed.out, slurp(std::string(RANGECAL_SOURCE_DIR) + "/docs/effects.md"));
  std::size_t longest = 0;
  for (std::size_t at = 0, end = 0; at < printed.out.size(); at = end + 1) {
    end = printed.out.find('\n', at);
    longest = std::max(longest, end - at);
  }
  EXPECT_LE(longest, 120u);
}

TEST(EffectsCommand, TheHeadOfEveryEffectHasItsNumberAndItsSource) {
  for (const auto& effect : effect_registry()) {
    const EffectInfo& info = effect->info();
    const std::string head =
        head_of(slurp(std::string(RANGECAL_SOURCE_DIR) + "/problems/effects/" + info.id + ".cpp"));
    EXPECT_THAT(head, AnyOf(StartsWith(info.number + ". "), StartsWith(info.number + ", "))) << info.id;
    EXPECT_THAT(head, AllOf(HasSubstr("Source: " + info.source), Not(HasSubstr("docs/effects.md"))))
        << info.id;
  }
}

}  // namespace
}  // namespace rangecal::test
