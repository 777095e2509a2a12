// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "apps/run_binary.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "support/recordings.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;

// The shipped recordings were simulated with this curve (notebooks_data/scenes).
const Eigen::Vector3d true_alpha(0.0525, 0.8838, 0.0584);

/// Every coefficient within four of its own standard deviations of the truth: 6e-5 per coefficient by chance,
/// and the recordings are fixed.
void expect_true_curve(const Calibration& calibration) {
  ASSERT_EQ(calibration.order(), 2);
  ASSERT_TRUE(calibration.alpha_covariance);
  for (int i = 0; i < 3; ++i)
    EXPECT_LT(std::abs(calibration.alpha[i] - true_alpha[i]),
              4.0 * std::sqrt((*calibration.alpha_covariance)(i, i)))
        << i;
}

TEST(CalibrateCommand, ARecordingNamedTwiceIsRefused) {
  const TemporaryFolder folder;
  namespace fs = std::filesystem;
  fs::copy(shipped("field-layout"), folder.file("monday"));
  fs::create_directory_symlink("monday", folder.file("link"));
  fs::create_directory(folder.file("hard"));
  fs::copy_file(folder.file("monday/recording.yaml"), folder.file("hard/recording.yaml"));
  fs::create_hard_link(folder.file("monday/observations.csv"), folder.file("hard/observations.csv"));
  for (const char* command : {"calibrate", "compare", "diagnose"})
    for (const char* other : {"monday", "./monday", "link", "hard"}) {
      const RunResult result =
          run(std::string(command) + " monday " + other, "", "cd " + folder.path() + ";");
      EXPECT_EQ(result.code, 2) << command << " " << other;
      EXPECT_THAT(result.err, HasSubstr("its readings would count twice")) << command << " " << other;
    }
}

TEST(CalibrateCommand, LandmarksToJsonAndBack) {
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json");
  const RunResult result = run("calibrate " + shipped("field-layout") + " --json " + json);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("converged by marginal"));
  EXPECT_THAT(result.out, HasSubstr("95 % band"));
  EXPECT_THAT(result.out, HasSubstr("degrees"));
  EXPECT_THAT(result.out, HasSubstr("500 read, 500 used"));
  const Calibration calibration = load_calibration(json);
  EXPECT_EQ(calibration.method, Method::marginal);
  EXPECT_EQ(calibration.noise.law, NoiseLaw::f_squared);
  EXPECT_THAT(result.out, HasSubstr("95 % band  with the choice  one reading scatters"));
  EXPECT_THAT(result.out, HasSubstr("\nChoice     the 95 % band and the standard deviations hold given"));
  EXPECT_THAT(result.out, HasSubstr("weighs the 7 models tried by how likely each is"));
  EXPECT_TRUE(calibration.covariance_with_choice);
  EXPECT_EQ(calibration.landmarks.size(), 5u);
  EXPECT_EQ(calibration.landmarks[0].label, "A");
  EXPECT_TRUE(calibration.landmarks[0].covariance);
  EXPECT_EQ(calibration.stops.size(), 10u);
  EXPECT_GT(calibration.range_max_m, calibration.range_min_m);
  expect_true_curve(calibration);
  // AIC counts 3 alpha, sigma_e, sigma_theta and 5 landmarks: 15 parameters.
  EXPECT_NEAR(*calibration.aic, 2.0 * (*calibration.marginal_nll + 15.0), 1e-9);
  // The file is the library's: written again it is the same text.
  EXPECT_EQ(slurp(json), calibrations_to_json(load_calibrations(json)));
}

TEST(CalibrateCommand, SaysWhyABandHasNoChoiceInIt) {
  const std::string pairs = "calibrate " + shipped("pairs-2016");
  // Of order 2 the next noise law lies 515 above the lowest AIC: nothing is left open.
  const std::string sure = run(pairs + " --order 2").out;
  EXPECT_THAT(sure, HasSubstr("95 % band  one reading scatters"));
  EXPECT_THAT(sure,
              HasSubstr("none of\n           the other 3 models is likely and known well enough to count"));
  // Nothing was chosen: nothing to say.
  EXPECT_THAT(run(pairs + " --order 2 --noise f2").out, ::testing::Not(HasSubstr("\nChoice ")));
  EXPECT_THAT(run("calibrate " + shipped("field-layout") + " --method full").out,
              HasSubstr("--method\n           marginal counts their choice too"));
}

TEST(CalibrateCommand, ThePageSaysWhichBandItsChartShows) {
  const TemporaryFolder folder;
  const std::string html = folder.file("page.html"), rec = shipped("field-layout");
  const RunResult result = run("calibrate " + rec + " --report " + html);
  if (result.err.find("no charting library") != std::string::npos) GTEST_SKIP() << result.err;
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(slurp(html), HasSubstr("the chart of the curve shows the band with the choice"));
  EXPECT_THAT(slurp(html), HasSubstr(" band, the choice of order and noise law in it,"));
  EXPECT_THAT(slurp(html), ::testing::Not(HasSubstr("above hold")));
  ASSERT_EQ(run("calibrate " + rec + " --method full --report " + html).code, 0);
  EXPECT_THAT(slurp(html), HasSubstr("the chart of the curve shows the band given them"));
}

TEST(CalibrateCommand, NoiseShapeOfLandmarksIsInPageAndFile) {
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json");
  const RunResult result = run("calibrate " + shipped("field-layout") +
                               " --order 2 --noise f2 --noise-shape student-t --json " + json);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("range noise is student-t with nu"));
  EXPECT_THAT(result.out, HasSubstr("bearing noise is student-t with nu"));
  const Calibration calibration = load_calibration(json);
  ASSERT_EQ(calibration.noise_shapes.size(), 2u);
  EXPECT_GT(calibration.noise_shapes.at("range").parameters.at("nu"), 4.0);  // the noise was drawn Gaussian
  expect_true_curve(calibration);
  // 15 parameters as for the Gaussian, and nu of each channel.
  EXPECT_NEAR(*calibration.aic, 2.0 * (*calibration.marginal_nll + 17.0), 1e-9);
  const auto notes = nlohmann::json::parse(slurp(json)).at("notes").get<std::vector<std::string>>();
  EXPECT_THAT(notes, ::testing::ElementsAre(HasSubstr("noise is of ranges student-t with nu")));
  EXPECT_EQ(slurp(json), calibrations_to_json(load_calibrations(json), notes));
}

TEST(CalibrateCommand, TiltSaysWhatTheDesignCannotSee) {
  const RunResult line = run("calibrate " + shipped("field-layout") + " --tilt");
  EXPECT_EQ(line.code, 0) << line.err;
  EXPECT_THAT(line.out, ::testing::StartsWith("Plane      This design does not see a tilt of the plane"));
  const RunResult refused = run("calibrate " + shipped("field-layout") + " --tilt --method full");
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, ::testing::HasSubstr("--tilt goes with --method marginal"));
}

TEST(CalibrateCommand, AllMethodsInOneFile) {
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json");
  const RunResult result = run("calibrate " + shipped("field-layout") + " --method all --json " + json);
  ASSERT_EQ(result.code, 0) << result.err;
  const std::vector<Calibration> all = load_calibrations(json);
  ASSERT_EQ(all.size(), 4u);
  for (const Calibration& calibration : all)
    EXPECT_EQ(calibration.outcome, Outcome::converged) << to_string(calibration.method);
  // Each maximum is the best by its own likelihood: full by the joint NLL, marginal by the marginal one up to
  // the REML correction of its sigmas, which is far below 1 nat here (15 parameters, 1000 numbers).
  for (const Calibration& other : {all[0], all[1], all[3]})
    EXPECT_LT(*all[2].joint_nll, *other.joint_nll + 1e-6);
  for (const Calibration& other : {all[0], all[1], all[2]})
    EXPECT_LT(*all[3].marginal_nll, *other.marginal_nll + 0.5);
  EXPECT_THAT(all[2].covariance_reason, HasSubstr("optimistic"));
}

TEST(CalibrateCommand, PairsRecordingWithCheck) {
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json");
  const RunResult result = run("calibrate " + shipped("pairs-2016") + " --check --json " + json);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("agrees"));
  const Calibration calibration = load_calibration(json);
  EXPECT_EQ(calibration.kind, RecordingKind::pairs);
  expect_true_curve(calibration);
}

TEST(CalibrateCommand, BothSolversReachOneOptimumAndNloptAgrees) {
  const TemporaryFolder folder;
  double nll[2] = {};
  int i = 0;
  for (const std::string solver : {"ceres", "block"}) {
    const std::string json = folder.file(solver + ".json");
    const RunResult result =
        run("calibrate " + shipped("2021-setting") + " --method full --order 2 --noise f --check --solver " +
            solver + " --json " + json);
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_THAT(result.out, HasSubstr("agrees")) << solver;
    nll[i++] = *load_calibration(json).joint_nll;
  }
  EXPECT_NEAR(nll[0], nll[1], 1e-6);
}

TEST(CalibrateCommand, FromAnotherCalibrationSaysWhatChanged) {
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json");
  ASSERT_EQ(run("calibrate " + shipped("field-layout") + " --json " + json).code, 0);
  const RunResult same = run("calibrate " + shipped("field-layout") + " --from " + json);
  ASSERT_EQ(same.code, 0) << same.err;
  EXPECT_THAT(same.out, HasSubstr("f moved by up to 0.0 mm"));
  EXPECT_THAT(same.out, HasSubstr("within chance"));

  Calibration other = load_calibration(json);
  other.alpha[0] += 0.5;  // half a metre: beyond any chance
  save_calibrations({other}, json);
  const RunResult moved = run("calibrate " + shipped("field-layout") + " --from " + json);
  ASSERT_EQ(moved.code, 0) << moved.err;
  EXPECT_THAT(moved.out, HasSubstr("f moved by up to 500.0 mm"));
  EXPECT_THAT(moved.out, HasSubstr("the change is significant"));
}

TEST(CalibrateCommand, FromAnotherOrderSaysWhyNothingIsKnown) {
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json"),
                    rec = "calibrate " + shipped("pairs-2016") + " --noise f2";
  ASSERT_EQ(run(rec + " --order 2 --json " + json).code, 0);
  const RunResult other = run(rec + " --order 3 --from " + json);
  EXPECT_EQ(other.code, 0) << other.err;
  EXPECT_THAT(other.out, HasSubstr("significance: unknown, since the orders differ (2 and 3)"));
  const RunResult same = run(rec + " --order 2 --from " + json);
  EXPECT_THAT(same.out,
              HasSubstr("the change is within chance: T^2 = 0.0 over 3 coefficients, p = 1 by F with 3 and"));
  EXPECT_THAT(same.out, HasSubstr("freedom, given order and noise law"));
}

TEST(CalibrateCommand, NumericsHaveTheBoundAndTheBatches) {
  const RunResult landmarks = run("calibrate " + shipped("field-layout"));
  EXPECT_THAT(landmarks.out,
              HasSubstr("Cramer-Rao bound of alpha (standard deviations) at the estimate: 0.00"));
  EXPECT_THAT(landmarks.out,
              HasSubstr("the same at the true stops and landmarks, curve and sigmas as estimated"));
  EXPECT_THAT(landmarks.out, ::testing::Not(HasSubstr("Shapiro-Wilk")));
  const std::string pairs = "calibrate " + shipped("pairs-2016");
  const RunResult result = run(pairs);
  EXPECT_THAT(result.out, HasSubstr("Cramer-Rao bound of alpha"));
  EXPECT_THAT(result.out, ::testing::Not(HasSubstr("true stops")));
  EXPECT_THAT(result.out, HasSubstr("12 batches at one distance each"));
  EXPECT_THAT(result.out, ::testing::ContainsRegex("runs test\\) +p < 0.05 in [0-9]+ of 12 batches"));
  EXPECT_THAT(result.out, ::testing::ContainsRegex("Shapiro-Wilk\\) +p < 0.05 in [0-9]+ of 12 batches"));
  // Eq. 13-15 by a second program: 269.848, 749.175, 1003.618, 664.530.
  EXPECT_THAT(result.out, HasSubstr("H0 269.8, H1 749.2, H2 1003.6, H3 664.5: H2 is"));
  EXPECT_THAT(run(pairs + " --method approximate").out,
              HasSubstr("sigma_e^2 as printed (noise d^2, eq. 26)"));
}

TEST(CalibrateCommand, TheCriterionIsSaidAndRefusedWhereThereIsNone) {
  const std::string pairs = "calibrate " + shipped("pairs-2016");
  EXPECT_THAT(run(pairs + " --criterion bic").out, HasSubstr("(lowest BIC of 16 models; next: "));
  EXPECT_THAT(run(pairs + " --criterion aicc").out, HasSubstr("(lowest AICc of 16 models; next: "));
  const RunResult cv = run(pairs + " --criterion cv");
  EXPECT_THAT(cv.out, HasSubstr("(order by cross-validation, noise by AIC of 16 models)"));
  EXPECT_THAT(cv.out, HasSubstr("Note       order by the RMS error of readings left out in 10 folds"));
  EXPECT_THAT(run(pairs + " --criterion thirds").out,
              HasSubstr("(order by thirds, noise by AIC of 16 models)"));
  for (const auto& [command, part] :
       {std::pair<std::string, const char*>{pairs + " --criterion best",
                                            "not one of aic, aicc, bic, cv, thirds"},
        {pairs + " --criterion cv --order 2", "criterion cv chooses the order, and order 2 is given"},
        {"calibrate " + shipped("field-layout") + " --criterion bic",
         "criterion bic is for known distances"}}) {
    const RunResult refused = run(command);
    EXPECT_EQ(refused.code, 2) << command;
    EXPECT_EQ(count_of(refused.err, "\n"), 1) << refused.err;
    EXPECT_THAT(refused.err, HasSubstr(part));
  }
}

TEST(CalibrateCommand, WhatIsConstantAtAStopIsAskedOfDiagnoseFirst) {
  const TemporaryFolder folder;
  std::filesystem::copy(
      shipped("field-layout"), folder.path(),
      std::filesystem::copy_options::recursive | std::filesystem::copy_options::overwrite_existing);
  std::istringstream rows(slurp(folder.file("observations.csv")));
  std::string table, line;
  std::getline(rows, table);
  ASSERT_EQ(table, "stop,landmark,repeat,range_m,bearing_rad");
  for (table += "\n"; std::getline(rows, line);) {  // bearings off by up to 0.05 rad, the same in each repeat
    const std::size_t first = line.find(','), last = line.rfind(',');
    const double off = 0.05 * std::sin(7.0 * std::stoi(line.substr(0, first)) + 3.0 * line[first + 1]);
    table += line.substr(0, last + 1) + std::to_string(std::stod(line.substr(last + 1)) + off) + "\n";
  }
  folder.write("observations.csv", table);
  const RunResult result = run("calibrate " + folder.path() + " --order 2 --noise f2");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("\nNext       'rangecal diagnose " + folder.path() + "'"));
}

TEST(CalibrateCommand, ADriftedPathIsNotDeterminedByTheClosedForm) {
  const std::string walk = testing::recordings() + "/rangecal/brenner-lego";
  RANGECAL_REQUIRE_RECORDING(walk);
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json");
  const RunResult result = run("calibrate " + walk + " --method closed-form --json " + json);
  EXPECT_EQ(result.code, 1) << result.err;
  EXPECT_THAT(result.out, HasSubstr("NOT DETERMINED by this recording"));
  EXPECT_THAT(result.out, HasSubstr("do not meet"));
  EXPECT_THAT(result.out, HasSubstr("try --method marginal"));
  const Calibration calibration = load_calibration(json);
  EXPECT_EQ(calibration.outcome, Outcome::unobservable);
  EXPECT_THAT(calibration.weakest_direction, HasSubstr("not determined along"));
}

TEST(CalibrateCommand, TwoPlacesAreTooFew) {
  const TemporaryFolder folder;
  std::filesystem::copy(
      shipped("field-layout"), folder.path(),
      std::filesystem::copy_options::recursive | std::filesystem::copy_options::overwrite_existing);
  std::string rows = "stop,landmark,range_m,bearing_rad\n";
  for (const char* stop : {"0", "1"})
    for (const char* rest : {"A,1.0,0.1", "B,2.0,-0.3", "C,1.5,0.7", "D,3.0,1.0"})
      rows += std::string(stop) + "," + rest + "\n";
  folder.write("observations.csv", rows);
  const std::string json = folder.file("cal.json");
  for (const char* method : {"marginal", "closed-form", "all"}) {
    const RunResult result = run("calibrate " + folder.path() + " --method " + method + " --json " + json);
    EXPECT_EQ(result.code, 2) << method;
    EXPECT_EQ(result.out, "");
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_THAT(result.err, HasSubstr(folder.path() + ": too_few_data: 2 place(s) to stand"));
    EXPECT_THAT(result.err, HasSubstr("at least 3 separate places"));
    EXPECT_FALSE(std::filesystem::exists(json));
  }
  EXPECT_EQ(run("compare " + folder.path()).code, 2);
  const RunResult diagnosis = run("diagnose " + folder.path() + " --json " + json);
  EXPECT_EQ(diagnosis.code, 2);
  EXPECT_THAT(diagnosis.err, HasSubstr("too_few_data: 2 place(s) to stand"));
  EXPECT_FALSE(std::filesystem::exists(json));
}

TEST(CalibrateCommand, NoFileIsLeftAfterAnError) {
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json");
  EXPECT_EQ(run("calibrate /no/such/folder --json " + json).code, 2);
  EXPECT_EQ(run("calibrate " + shipped("field-layout") + " --order x --json " + json).code, 2);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  const RunResult nowhere =
      run("calibrate " + shipped("field-layout") + " --json " + folder.file("no/such/cal.json"));
  EXPECT_EQ(nowhere.code, 2);
  EXPECT_THAT(nowhere.err, HasSubstr("cal.json"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(CalibrateCommand, AnOldFileSurvivesAnErrorWhole) {
  const TemporaryFolder folder;
  folder.write("cal.json", "old\n");
  EXPECT_EQ(run("calibrate /no/such/folder --json " + folder.file("cal.json")).code, 2);
  EXPECT_EQ(slurp(folder.file("cal.json")), "old\n");
}

TEST(CalibrateCommand, FolderWithoutPermission) {
  // Root reads and writes everywhere: the command then runs as nobody.
  const TemporaryFolder folder;
  std::filesystem::permissions(folder.path(),
                               std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec |
                                   std::filesystem::perms::others_read | std::filesystem::perms::others_exec);
  const bool root = ::geteuid() == 0;
  const std::string as_nobody = root ? "setpriv --reuid=65534 --regid=65534 --clear-groups" : "";
  if (root && run("--version", "", as_nobody).code != 0)
    GTEST_SKIP() << "the binary cannot be run as nobody here (its folder is closed, or setpriv is missing)";
  const TemporaryFolder data;
  std::filesystem::copy(
      shipped("pairs-2016"), data.path(),
      std::filesystem::copy_options::recursive | std::filesystem::copy_options::overwrite_existing);
  std::filesystem::permissions(data.path(), std::filesystem::perms::all);
  const RunResult result =
      run("calibrate " + data.path() + " --json " + folder.file("cal.json"), "", as_nobody);
  EXPECT_EQ(result.code, 2) << result.err;
  EXPECT_THAT(result.err, HasSubstr("cannot be written"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));

  std::filesystem::permissions(data.file("pairs.csv"), std::filesystem::perms::none);
  const RunResult closed = run("calibrate " + data.path(), "", as_nobody);
  EXPECT_EQ(closed.code, 2) << closed.err;
  EXPECT_THAT(closed.err, HasSubstr("pairs.csv"));
}

}  // namespace
}  // namespace rangecal::test
