// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "fleet/database.hpp"

namespace rangecal::app {

// The table `inputs`: each sensor once, by its folder's identity, under the name that it was first given.

/// How a unit's theta and questions are made of its readings: fits of another file of results are made anew.
constexpr const char* fit_version = "3";

/// Whether `schema` holds the tables of a fleet; throws InputError naming `file` where it holds others.
bool holds_fleet(Database& database, const std::string& schema, const std::string& file);

/// Adds the columns that files of earlier versions have not, and looks up where their units are, or where they have moved to
/// under the same name. Of two names of one folder the first stays.
void identify_inputs(Database& database);

/// Has the units of a file that was made by another `fit_version` fitted anew.
void renew_fits(Database& database);

/// Adds recordings, and those in folders of recordings. Throws InputError for what is neither.
void take_recordings(Database& database, const std::vector<std::string>& given);

/// Takes in the units of another file of the same order and noise law; of a unit in both that differs, the other's row.
void merge_fleet(Database& database, const std::string& file);

struct Changes {
  std::int64_t changed = 0, renewed = 0;      ///< forgotten: by their files; by the version that fitted them
  std::int64_t gone = 0, gone_unrenewed = 0;  ///< kept; those of them that another version fitted
  std::string first_gone;
};
/// What there is to say of units that are gone; empty where none is.
std::string gone_in_words(const Changes& changes);

/// Forgets the rows of units whose files are no longer what they were when fitted, and of those that another version fitted,
/// for them to be fitted anew. A unit that is gone keeps its row: its readings were taken, and a merged shard may have been
/// fitted on another computer. `table` has a row per unit: `name, readings` (NULL: could not be read), `stamp, contents`.
Changes forget_changed(Database& database, const std::string& table = "units");

}  // namespace rangecal::app
