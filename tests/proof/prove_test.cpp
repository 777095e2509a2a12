// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "proof/fresh.hpp"
#include "proof/journal.hpp"
#include "proof/sealed.hpp"
#include "proof/table.hpp"
#include "proof/twins.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::proof {
namespace {

using ::testing::HasSubstr;

Diagnosis explained(std::vector<std::string> effects, std::vector<std::vector<std::string>> twins = {}) {
  Diagnosis d;
  d.verdict = Verdict::explained;
  d.final_effects = effects;
  Explanation best;
  best.effects = effects;
  best.indistinguishable_from = twins;
  d.explanations.push_back(best);
  return d;
}

bool never(const std::vector<std::string>&) { return false; }
bool always(const std::vector<std::string>&) { return true; }

TEST(Classify, EveryClass) {
  const std::vector<std::string> truth{"tilt"};
  const Diagnosis quiet;
  EXPECT_EQ(classify(quiet, {}, never), Answer::quiet);
  EXPECT_EQ(classify(quiet, truth, never), Answer::missed);
  EXPECT_EQ(classify(explained({"tilt"}), {}, never), Answer::false_alarm);
  EXPECT_EQ(classify(explained({"tilt"}), truth, never), Answer::right_name);
  EXPECT_EQ(classify(explained({"lever_arm"}), truth, always), Answer::wrong_name);
  EXPECT_EQ(classify(explained({"lever_arm"}, {{"tilt"}}), truth, always), Answer::right_set);
  EXPECT_EQ(classify(explained({"lever_arm"}, {{"tilt"}}), truth, never), Answer::wrong_set);
  EXPECT_EQ(classify(explained({"lever_arm"}, {{"range_scale"}}), truth, always), Answer::wrong_set);
  EXPECT_EQ(classify(explained({"a"}, {{"b"}, {"c"}, {"tilt"}}), truth, always), Answer::right_set);
  EXPECT_EQ(classify(explained({"a"}, {{"b"}, {"c"}, {"d"}, {"tilt"}}), truth, always), Answer::wrong_set);
  EXPECT_EQ(classify(explained({"tilt", "lever_arm"}), {"lever_arm", "tilt"}, never), Answer::right_name);
  Diagnosis generic = explained({"generic"});
  generic.verdict = Verdict::unexplained;
  EXPECT_EQ(classify(generic, truth, always), Answer::unexplained);
}

TEST(Coverage, CountsIntervalsThatHaveATruth) {
  Diagnosis d = explained({"tilt"});
  d.explanations[0].parameters = {{"tilt.angle_rad", 0.1, 0.01, 0.08, 0.12, {}},
                                  {"tilt.other", 1.0, 0.1, 0.8, 1.2, {}}};
  const Coverage held = coverage(d, {{"tilt.angle_rad", 0.09}}),
                 missed = coverage(d, {{"tilt.angle_rad", 0.19}});
  EXPECT_EQ(std::make_pair(held.covered, held.intervals), std::make_pair(1, 1));
  EXPECT_EQ(held.outside, "");
  EXPECT_EQ(std::make_pair(missed.covered, missed.intervals), std::make_pair(0, 1));
  EXPECT_EQ(missed.outside, "tilt.angle_rad 0.19 [0.08 0.12]");
}

TEST(Twins, ExactTwinsLeaveNothingAndStrangersDo) {
  const Case c = draw_case("twins", 5, 1, "turning");
  const SeedModel model(c.clean);
  const Signatures signatures(model, c.seed);
  const Signal signal = projected(model, c.planted);
  const double lambda = signal.squared_norm();
  EXPECT_NEAR(lambda, 100.0, 3.0);
  const std::vector<std::string> truth = c.truth, stranger{"pixel_locking"}, nobody{"no_such_effect"};
  EXPECT_LT(signatures.left(signal, truth), 7.0);
  EXPECT_GT(signatures.left(signal, stranger), 60.0);
  EXPECT_NEAR(signatures.left(signal, nobody), lambda, 1e-6 * lambda);
}

TEST(DrawCase, SameSeedSameWorldOtherSeedOther) {
  const Case a = draw_case("pair", 7, 3, "line"), b = draw_case("pair", 7, 3, "line"),
             c = draw_case("pair", 8, 3, "line");
  EXPECT_EQ(a.truth, b.truth);
  EXPECT_EQ(a.sizes, b.sizes);
  EXPECT_EQ(record(a, a.planted).readings.range_m, record(b, b.planted).readings.range_m);
  EXPECT_NE(a.sizes, c.sizes);
  EXPECT_EQ(a.truth.size(), 2u);
  EXPECT_THROW(draw_case("no-row", 1, 0, "line"), InputError);
}

TEST(Fresh, CountsAnswersAndPrintsTheTable) {
  // A diagnosis that never alarms is right on clean worlds and misses all others.
  FreshOptions options;
  options.worlds = 3, options.seed = 1, options.rows = {"clean", "lambda-100"};
  const FreshResult result =
      run_fresh(options, [](std::span<const Recording>, const DiagnoseOptions&) { return Diagnosis{}; });
  ASSERT_EQ(result.scores.size(), 13u);  // 5 clean worlds a design, 3 others
  const std::vector<Line> lines = proof_lines(result.scores);
  EXPECT_EQ(lines[0].what, "clean, line: alarm");
  EXPECT_TRUE(lines[0].met);
  EXPECT_EQ(lines[2].figure, 0.0);
  EXPECT_FALSE(lines[2].met);
  EXPECT_THAT(proof_text(result.scores, {}), HasSubstr("no_mismatch x"));
}

TEST(Rows, SomeShareTheirDraws) {
  const Case three = draw_case("many-3", 4, 1, "turning"),
             simulated = draw_case("simulation-many-3", 4, 1, "turning");
  EXPECT_EQ(simulated.truth, three.truth);
  EXPECT_EQ(simulated.sizes, three.sizes);
  const Case two = draw_case("many-2", 4, 1, "turning"),
             beside = draw_case("beside-unknown", 4, 1, "turning");
  ASSERT_EQ(beside.truth.size(), 3u);
  EXPECT_EQ(std::vector<std::string>(beside.truth.begin(), beside.truth.begin() + 2), two.truth);
  EXPECT_EQ(beside.truth[2], beside.unknown);
  EXPECT_FALSE(world::effect_info(beside.unknown).catalogued);
}

Diagnosis in_part(std::vector<std::string> effects, const std::string& channel,
                  const std::string& covariate) {
  Diagnosis d = explained(effects);
  d.verdict = Verdict::partly_explained;
  d.final_effects.push_back("generic");
  Finding named, rest;
  named.channel = "range", named.covariate = "time", named.effects = effects;
  rest.channel = channel, rest.covariate = covariate, rest.effects = {"generic"};
  d.location = {named, rest};
  return d;
}

TEST(Score, OfCausesBesideAnUnknownOne) {
  Case c;
  c.row = "beside-unknown", c.truth = {"tilt", "warmup_drift", "motor_detents"}, c.unknown = "motor_detents";
  const Score all = score(c, in_part({"tilt", "warmup_drift"}, "bearing", "sensor_bearing"));
  EXPECT_EQ(all.result, Answer::right_name);
  EXPECT_EQ(all.location, "bearing/sensor_bearing");
  EXPECT_EQ(std::make_pair(all.names.found, all.causes), std::make_pair(2, 2));
  const Score elsewhere = score(c, in_part({"tilt", "warmup_drift"}, "range", "sensor_bearing"));
  EXPECT_FALSE(elsewhere.located);
  EXPECT_EQ(elsewhere.result, Answer::unexplained);
  const Score one = score(c, in_part({"tilt"}, "bearing", "sensor_bearing"));
  EXPECT_TRUE(one.located);
  EXPECT_EQ(one.result, Answer::unexplained);
  const Score wrong = score(c, in_part({"tilt", "lever_arm"}, "bearing", "sensor_bearing"));
  EXPECT_EQ(wrong.result, Answer::wrong_name);
  EXPECT_EQ(wrong.names.wrong, 1);
  const Score whole = score(c, explained({"tilt", "warmup_drift"}));
  EXPECT_FALSE(whole.located);
  EXPECT_EQ(whole.result, Answer::unexplained);
}

TEST(Score, OfALargeCauseAsksForTheNote) {
  Case c;
  c.row = "large", c.truth = {"tilt"};
  Diagnosis d = explained({"tilt"});
  EXPECT_FALSE(score(c, d).said_large.value());
  d.notes.push_back("tilt is unusually large: 4.1 times its typical size");
  const Score said = score(c, d);
  EXPECT_TRUE(said.said_large.value());
  const std::vector<Line> lines = proof_lines({said});
  EXPECT_EQ(lines[0].what, "1 to 3 old bounds: named, said to be large");
  EXPECT_EQ(lines[0].figure, 1.0);
  const std::vector<Score> read = read_scores(proof_csv({said}), "scores.csv");
  EXPECT_EQ(read.at(0).said_large, said.said_large);
}

/// A name is right if what it was told from no better is concealed: itself, an exact twin, a name in its place in another set.
TEST(Score, ANameHasTheProbabilityOfItsClass) {
  Diagnosis d = explained({"heading_drift", "sweep_motion", "tilt"});
  d.explanations.resize(1);
  d.explanations[0].indistinguishable_from = {{"heading_drift", "target_reflectance", "tilt"},
                                              {"lever_arm", "path_curvature", "tilt"}};
  d.members = {{"heading_drift", 0.9, {}, {}},
               {"sweep_motion", 0.75, {}, {}},
               {"tilt", 1.0, {}, {}},
               {"curve of range along time", 1.0, {}, {}}};
  Case c;
  c.row = "many-3", c.truth = {"target_reflectance", "settling", "path_curvature"};
  const Score scored = score(c, d);
  EXPECT_EQ(scored.probabilities, "heading_drift 0.9000 0; sweep_motion 0.7500 1; tilt 1.0000 0");
  EXPECT_EQ(read_scores(proof_csv({scored}), "scores.csv").at(0).probabilities, scored.probabilities);
  c.truth = {"bearing_drift"};
  d = explained({"heading_drift"});
  d.members = {{"heading_drift", 0.6, {}, {}}};
  EXPECT_EQ(score(c, d).probabilities, "heading_drift 0.6000 1") << "an exact twin";
  d.verdict = Verdict::no_mismatch;  // which names nothing, whatever it holds
  EXPECT_EQ(score(c, d).probabilities, "");
}

TEST(Score, OfAFormulaThatIsOffMayLeaveARest) {
  Case c;
  c.row = "formula-off", c.truth = {"tilt"}, c.shape_error = {0.1};
  EXPECT_EQ(score(c, explained({"tilt"})).result, Answer::right_name);
  EXPECT_EQ(score(c, in_part({"tilt"}, "range", "range")).result, Answer::right_name);
  const Score wrong = score(c, in_part({"tilt", "lever_arm"}, "range", "range"));
  EXPECT_EQ(wrong.result, Answer::wrong_name);
  EXPECT_EQ(wrong.names.wrong, 1);
  Diagnosis generic = explained({"generic"});
  generic.verdict = Verdict::unexplained;
  EXPECT_EQ(score(c, generic).result, Answer::unexplained);
}

TEST(Score, OfAWronglyStatedSpread) {
  Case c;
  c.row = "stated-sigma", c.truth = {"stated_sigma"};
  Diagnosis quiet;
  EXPECT_EQ(score(c, quiet).result, Answer::missed);
  quiet.unseen.push_back({});
  quiet.unseen.back().effect = "stop_effect";
  EXPECT_EQ(score(c, quiet).result, Answer::quiet);
  const Score wider =
      score(c, explained({"stop_effect"}));  // another name, if one that has it among its parameters
  EXPECT_EQ(wider.result, Answer::wrong_name);
  EXPECT_TRUE(wider.partly_right);
  const Score wrong = score(c, explained({"odometry_random_walk"}));
  EXPECT_EQ(wrong.result, Answer::wrong_name);
  EXPECT_EQ(wrong.names.wrong, 1);
  EXPECT_FALSE(wrong.partly_right);
}

TEST(Score, OfARandomDesignUnobservableIsNoAlarm) {
  Case c;
  c.row = "clean-any";
  Diagnosis d;
  d.verdict = Verdict::unobservable;
  EXPECT_EQ(score(c, d).result, Answer::quiet);
  EXPECT_EQ(score(c, explained({"tilt"})).result, Answer::false_alarm);
}

TEST(StatedSigma, IsHalfAndTwiceInTurns) {
  const Case half = draw_case("stated-sigma", 2, 0, "line"), twice = draw_case("stated-sigma", 2, 2, "line");
  EXPECT_EQ(record(half, half.planted).sigma_xy_m, 0.005);
  EXPECT_EQ(record(twice, twice.planted).sigma_xy_m, 0.02);
  EXPECT_EQ(half.planted.robot.placing_sigma_m, 0.01);
}

TEST(Sealed, ShaOfAbc) {  // FIPS 180-2, appendix B.1
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Sealed, CommitmentFailsOnAChangedKey) {
  const test::TemporaryFolder folder;
  const std::string home = folder.path() + "/sealed";
  make_concealed(home, 2, 11);
  const std::vector<std::string> recordings = concealed_recordings(home);
  ASSERT_EQ(recordings.size(), 2u);
  const auto silent = [](std::span<const Recording>, const DiagnoseOptions&) { return Diagnosis{}; };
  const SealedAnswer answer = answer_sealed(recordings[0], silent);
  EXPECT_NO_THROW(score_sealed(answer, silent));
  std::string key = read_file(key_file(recordings[0]));
  key[key.find("nonce") + 10] ^= 1;
  write_file(key_file(recordings[0]), key);
  try {
    open_key(recordings[0]);
    FAIL() << "a changed key was accepted";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("does not match the commitment"));
  }
}

/// Diagnosis stands for a fit here: it answers at once and counts how often it is asked.
TEST(Journal, AStoppedRunGoesOnAndNothingIsCountedTwice) {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("scores.csv");
  int asked = 0;
  const Diagnose quiet = [&](std::span<const Recording>, const DiagnoseOptions&) {
    ++asked;
    return Diagnosis{};
  };
  FreshOptions options;
  options.worlds = 3, options.seed = 5, options.rows = {"clean"}, options.design = "line";
  const FreshResult whole = run_fresh(options, quiet);
  ASSERT_EQ(asked, 5);  // clean worlds are 5/3 of those asked for
  // Stopped in the middle of the third line.
  std::string text = proof_csv({whole.scores[0], whole.scores[1], whole.scores[2]});
  text.resize(text.size() - 9);
  options.known = read_scores(text, path);
  ASSERT_EQ(options.known.size(), 2u);
  std::vector<Score> written;
  Journal journal(path, options.known);
  options.scored = [&](const Score& score) {
    written.push_back(score);
    journal.append(score);
  };
  asked = 0;
  const FreshResult resumed = run_fresh(options, quiet);
  EXPECT_EQ(asked, 3);
  EXPECT_EQ(written.size(), 3u);
  EXPECT_EQ(read_scores(read_file(path), path).size(), 5u);
  journal.finish(resumed.scores);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(key_of(resumed.scores[i]), key_of(whole.scores[i]));
    EXPECT_EQ(resumed.scores[i].seed, whole.scores[i].seed);
  }
  options.seed = 6;
  EXPECT_THROW(run_fresh(options, quiet), InputError);
}

}  // namespace
}  // namespace rangecal::proof
