// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/problems/world/physical/world.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::proof {

/// The diagnosis under proof.
using Diagnose = std::function<Diagnosis(std::span<const Recording>, const DiagnoseOptions&)>;

/// What an answer is worth.
enum class Answer {
  quiet,        ///< clean, and no alarm
  false_alarm,  ///< clean, and an alarm
  right_name,   ///< the planted effect(s), alone
  right_set,    ///< at most four sets with the truth among them, all of them twins in this design
  wrong_name,   ///< a single answer that is not the truth
  wrong_set,    ///< several, without the truth, too many, or with one that the data exclude
  missed,       ///< no alarm although something was planted
  unexplained   ///< an alarm and no name
};
const char* to_string(Answer answer);
inline bool is_right(Answer answer) { return answer == Answer::right_name || answer == Answer::right_set; }

/// An answer held against several causes: of the names given, those of concealed causes and the others. Of the sets that
/// an answer cannot tell apart the one with most causes counts; its names that are no cause are wrong.
struct Names {
  int found = 0, wrong = 0;
};
Names names_of(const std::vector<std::vector<std::string>>& sets, const std::vector<std::string>& truth);

/// One world as it was put to the diagnosis.
struct Case {
  std::string row, design;
  int index = 0;
  std::uint64_t seed = 0;  ///< draws the world; the noise of its recording comes from it too
  std::uint64_t effect_seed = 0;
  world::World clean, planted;
  std::vector<std::string> truth;  ///< planted ids, none for a clean world
  std::string outliers;            ///< of these the outliers beside the causes; empty: none
  std::string unknown;             ///< of these the one outside the catalogue beside the causes; empty: none
  std::vector<double> sizes;
  double value = 0.0;  ///< lambda or nats of the first effect
  bool in_nats = false;
  std::vector<double> shape_error;  ///< of the planted law, of every reading (shape_error.hpp); empty: none
  std::vector<std::string>
      out_of_reach;  ///< effects drawn before that cannot reach the target, "id (design)"
};

/// 95 % intervals of the best explanation whose parameter has a truth in the world.
struct Coverage {
  int covered = 0, intervals = 0;
  std::string outside;  ///< those that miss: "parameter truth [low high]; ..."
};

/// What came out of one world.
struct Score {
  std::string row, design;
  int index = 0;
  std::uint64_t seed = 0;
  std::string planted, answer;  ///< "a+b"; "a | b" for a set
  double size = 0.0, value = 0.0;
  Answer result = Answer::missed;
  int set_size = 0;
  double probability = 0.0, alarm_p = 1.0;
  bool partly_right = false;  ///< a pair: one right and none wrong; a stated spread: stop_effect alone
  int causes = 0;             ///< concealed, beside outliers and what is outside the catalogue
  Names names;                ///< of the answer, outliers' own left out
  std::string probabilities;  ///< of all names of the answer, and whether they are right (`probabilities_of`)
  std::optional<bool> outliers_named;  ///< as what they are
  std::optional<bool> said_large;      ///< what is named is said to be unusually large
  std::string location;  ///< "channel/covariate" first found; beside causes, of what has no name
  bool located = false;
  std::optional<double> gain_ratio, gain_excess_nats;
  Coverage coverage;
  std::optional<bool> held_out_improves;
  std::optional<bool> listed;  ///< one cause: in twins or unseen
  std::string experiment;      ///< code carried out, "none" where nothing was said to separate
  std::optional<bool> experiment_good;
  double seconds = 0.0;
  std::string error;  ///< what was thrown, if anything
};

/// All sets of effects that a diagnosis answers with, best first, the twins of the best after it.
std::vector<std::vector<std::string>> answer_sets(const Diagnosis& diagnosis);
/// "a+b | c".
std::string in_words(const std::vector<std::vector<std::string>>& sets);

/// "id probability right; ...": every name of a diagnosis with its probability, and 1 if a concealed cause is in the class that this is the
/// probability of: the name, its exact twins, and what replaces it in a set that the recording cannot tell apart. `is_cause`: of an id.
std::string probabilities_of(const Diagnosis& diagnosis,
                             const std::function<bool(const std::string&)>& is_cause);

/// The class of an answer. `is_twin` says whether a set of effects leaves too little of the planted one to be
/// told from it; it is asked only for members of a set that holds the truth.
Answer classify(const Diagnosis& diagnosis, const std::vector<std::string>& truth,
                const std::function<bool(const std::vector<std::string>&)>& is_twin);
/// The first location is in a channel and covariate of the planted effects.
bool is_located(const Diagnosis& diagnosis, const std::vector<std::string>& truth);
/// The intervals of a diagnosis against the truth.
Coverage coverage(const Diagnosis& diagnosis, const std::map<std::string, double>& truth);

/// Everything that is scored of one diagnosis; gains over the oracle need a second one and are left empty.
Score score(const Case& the_case, const Diagnosis& diagnosis);

}  // namespace rangecal::proof
