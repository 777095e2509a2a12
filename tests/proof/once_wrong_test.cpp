// SPDX-License-Identifier: BSD-3-Clause
// Worlds of `rangecal prove --fresh 300 --seed SEED` that a search before this one answered wrongly.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstdint>
#include <optional>
#include <ostream>
#include <string>

#include "proof/fresh.hpp"

namespace rangecal::proof {
namespace {

struct World {
  std::uint64_t seed;
  const char* row;
  int index;
  const char* design;
  const char* planted;
  std::optional<Answer> answer;  ///< none: all that was planted is in it
  const char* was;               ///< what it was taken for, and why
};

void PrintTo(const World& world, std::ostream* out) { *out << world.planted << " for " << world.was; }

class OnceWrong : public ::testing::TestWithParam<World> {};

TEST_P(OnceWrong, IsAnsweredRight) {
  const World& world = GetParam();
  const Score score = run_case(world.row, world.seed, world.index, world.design, false,
                               [](std::span<const Recording> recordings, const DiagnoseOptions& options) {
                                 return diagnose(recordings, options);
                               });
  EXPECT_EQ(score.planted, world.planted);
  if (world.answer) {
    EXPECT_EQ(to_string(score.result), std::string(to_string(*world.answer))) << score.answer;
  }
  EXPECT_TRUE(world.answer == Answer::unexplained || score.names.found == score.causes) << score.answer;
}

TEST(Threads, GiveTheSameNames) {
  std::string one, four;
  const auto on = [](int threads, std::span<const Recording> recordings, const DiagnoseOptions& options) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(threads));
    return diagnose(recordings, options);
  };
  run_case("pair", 202611222004, 164, "line", false,
           [&](std::span<const Recording> recordings, const DiagnoseOptions& options) {
             one = diagnosis_to_json(on(1, recordings, options));
             Diagnosis diagnosis = on(4, recordings, options);
             four = diagnosis_to_json(diagnosis);
             return diagnosis;
           });
  EXPECT_NE(one.find("sweep_motion"), std::string::npos);
  EXPECT_EQ(one, four);
}

INSTANTIATE_TEST_SUITE_P(
    Worlds, OnceWrong,
    ::testing::Values(
        World{202611211702, "noise-50", 17, "turning", "odometry_random_walk", std::nullopt,
              "one slip that gains as much"},
        World{202611211702, "noise-50", 294, "line", "odometry_random_walk", std::nullopt,
              "a bearing offset"},
        World{202611211702, "noise-50", 100, "line", "ambient_light", Answer::right_name,
              "nothing in the catalogue: the first sector asked about held no reading"},
        World{202611211702, "noise-50", 50, "line", "dropout", Answer::right_name,
              "nothing: few readings, all far away"},
        World{202611212008, "noise-50", 221, "turning", "cell_effect", Answer::right_name,
              "nothing in the catalogue: what its test predicted was less than it gains"},
        World{
            5, "noise-50", 34, "line", "noise_law", Answer::right_name,
            "nothing in the catalogue: a parabola in log f is no floor under noise that grows with its square"},
        World{202611211702, "outside", 33, "turning", "cable_guard", Answer::unexplained,
              "errors that cells share, whose refit was held against a curve's score"},
        World{202611211702, "outside", 44, "line", "cable_guard", Answer::unexplained,
              "a moved landmark, whose refit was held against a curve's score"},
        World{202611272146, "outside", 8, "line", "second_reflection", Answer::unexplained,
              "errors that cells share, beside a path whose formula might be off by metres"},
        World{202611272146, "outside", 12, "line", "stick_slip_mount", Answer::unexplained,
              "a bearing drift whose formula is off: the bearing jumps"},
        World{202611221624, "lambda-400", 19, "turning", "near_regime", Answer::right_name,
              "nothing in the catalogue: four stops of one place lay beyond the jump"},
        World{202611221624, "lambda-400", 44, "line", "near_regime", Answer::right_name,
              "nothing in the catalogue: the seed model had put a cell beyond the jump"},
        World{202611221624, "lambda-100", 214, "line", "pixel_locking", Answer::right_name,
              "errors of cells as well: stops lay in other modes"},
        World{202611280112, "lambda-50", 18, "line", "near_regime", Answer::right_name,
              "nothing in the catalogue: between the points of the grid it was predicted to gain half"},
        World{202611280112, "lambda-50", 28, "line", "pixel_locking", Answer::right_name,
              "nothing in the catalogue: its other optima were looked for beside another member alone"},
        World{202611222004, "twins", 184, "line", "bearing_offset", Answer::right_set,
              "settling that takes ten times as long as a stop"},
        World{202611222004, "pair", 164, "line", "sweep_motion+bearing_scale", Answer::right_name,
              "nothing: the best pair, by far the likeliest, was not clean"},
        World{202611222004, "pair", 170, "line", "bearing_offset+bearing_drift", Answer::right_set,
              "nothing: a line is a curve, too"},
        World{202611222004, "pair", 201, "turning", "wheel_slip+path_curvature", Answer::right_name,
              "errors of the stops"},
        World{911, "pair", 20, "line", "range_eccentricity+sweep_motion", Answer::right_name,
              "nothing in the catalogue: neither was among the three best single names"},
        World{77002, "pair", 296, "line", "cyclic_error+warmup_drift", Answer::right_name,
              "nothing: 99 nats beyond any curve, but a curve found a trace, p 0.0008"},
        World{202611251640, "many-3", 19, "turning", "encoder_eccentricity+range_eccentricity+lever_arm",
              Answer::right_name, "the second alone: each of the others hides the other"},
        World{20261128, "many-3", 18, "line", "path_curvature+heading_drift+range_eccentricity",
              Answer::right_set, "a curve along time, in whose place no single name is as good"},
        World{20261128, "large", 8, "line", "wheel_slip", Answer::right_name,
              "errors of the stops: the slip was fitted worse than no slip"},
        World{20261128, "large", 14, "line", "path_curvature", Answer::right_name,
              "errors of the stops: the linearised problem saw a hundredth of it"},
        World{20261128, "beside-unknown", 5, "turning", "heading_drift+range_eccentricity+cable_guard",
              Answer::right_name, "a path whose formula is off, by what no reading held"},
        World{50450341, "beside-unknown", 31, "turning", "warmup_drift+range_eccentricity+second_reflection",
              Answer::right_name, "nothing: a curve was asked for that no set held any more"},
        World{77002, "pair", 38, "line", "warmup_drift+pixel_locking", std::nullopt,
              "nothing: 89 nats beyond any curve, but cells hung together, p 0.001"}));

}  // namespace
}  // namespace rangecal::proof
