// SPDX-License-Identifier: BSD-3-Clause
#include "proof/everyday.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "proof/fresh.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"

namespace rangecal::proof {
namespace {

TEST(Everyday, EveryKindIsDrawnAlikeFromItsSeed) {
  for (const std::string& kind : everyday_kinds()) {
    const EverydayTable one = draw_everyday(kind, 7), same = draw_everyday(kind, 7),
                        other = draw_everyday(kind, 8);
    SCOPED_TRACE(kind);
    EXPECT_EQ(one.recording.pairs.reading_m, same.recording.pairs.reading_m);
    EXPECT_NE(one.recording.pairs.reading_m, other.recording.pairs.reading_m);
    EXPECT_GE(one.recording.pairs.size(), 400u);
    EXPECT_LE(one.recording.pairs.size(), 800u);
    EXPECT_EQ(one.causes.empty(), kind == "reciprocal");
    for (const double reading : one.recording.pairs.reading_m) EXPECT_GT(reading, 0.0);
  }
  EXPECT_THROW(draw_everyday("none", 1), InputError);
}

Diagnosis answer(Verdict verdict, std::vector<std::string> effects) {
  Diagnosis d;
  d.verdict = verdict;
  d.final_effects = std::move(effects);
  return d;
}

TEST(Everyday, RightIsEveryCauseAndNothingElse) {
  EverydayTable table;
  table.kind = "two-devices";
  table.causes = {{"device_offset", "target_reflectance"}, {"warmup_drift"}};
  const auto result = [&](Verdict verdict, std::vector<std::string> effects) {
    return score_everyday(table, answer(verdict, std::move(effects)));
  };
  EXPECT_EQ(result(Verdict::explained, {"warmup_drift", "target_reflectance"}).result, Answer::right_name);
  EXPECT_EQ(result(Verdict::explained, {"warmup_drift"}).result, Answer::unexplained);
  EXPECT_EQ(result(Verdict::partly_explained, {"warmup_drift", "device_offset", "generic"}).result,
            Answer::unexplained);
  const Score wrong = result(Verdict::explained, {"warmup_drift", "device_offset", "noise_law"});
  EXPECT_EQ(wrong.result, Answer::wrong_name);
  EXPECT_EQ(wrong.names.found, 2);
  EXPECT_EQ(wrong.names.wrong, 1);
  EXPECT_EQ(result(Verdict::no_mismatch, {}).result, Answer::missed);
  table.causes = {{"covariate_drift"}};
  EXPECT_EQ(result(Verdict::explained, {"covariate_drift:supply_v"}).result, Answer::right_name);
  table.causes = {};
  EXPECT_EQ(result(Verdict::no_mismatch, {}).result, Answer::quiet);
  EXPECT_EQ(result(Verdict::unexplained, {"generic"}).result, Answer::false_alarm);
}

TEST(Everyday, PlainTablesAreExplained) {
  for (const int index : {0, 3, 4}) {  // a temperature, received power, humidity
    const Score score = run_case("everyday", 2025, index, "line", false,
                                 [](std::span<const Recording> recordings, const DiagnoseOptions& options) {
                                   return diagnose(recordings, options);
                                 });
    EXPECT_EQ(score.result, Answer::right_name) << score.planted << ": " << score.answer;
  }
}

TEST(Everyday, TheShippedTablesAreExplained) {
  const std::string folder = std::string(RANGECAL_SOURCE_DIR) + "/notebooks_data/everyday/";
  for (const std::string& kind : everyday_kinds()) {
    const auto key = nlohmann::json::parse(read_file(folder + kind + "/key.json"));
    EverydayTable table;
    table.kind = key.at("kind");
    table.causes = key.at("causes").get<std::vector<std::vector<std::string>>>();
    DiagnoseOptions options;
    options.held_out = options.unseen = options.next_experiments = false;
    const Recording recording = load_recording(folder + kind);
    const Score score = score_everyday(table, diagnose({&recording, 1}, options));
    EXPECT_EQ(score.result, table.causes.empty() ? Answer::quiet : Answer::right_name)
        << kind << ": " << score.answer;
  }
}

}  // namespace
}  // namespace rangecal::proof
