// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/inputs.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "fleet/fingerprint.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::app {
namespace {

namespace fs = std::filesystem;

bool has_column(Database& database, const std::string& schema, const char* table, const char* column) {
  return database.count(fmt::format("SELECT count(*) FROM pragma_table_info('{}', '{}') WHERE name = '{}'",
                                    table, schema, column)) > 0;
}

void add_column(Database& database, const char* table, const char* column, const char* type) {
  if (!has_column(database, "main", table, column))
    database.execute(fmt::format("ALTER TABLE {} ADD COLUMN {} {}", table, column, type));
}

bool same_fits(Database& database, const std::string& schema) {
  return database.count(fmt::format("SELECT count(*) FROM {}.meta WHERE key = 'fit' AND value = '{}'", schema,
                                    fit_version)) > 0;
}

bool is_recording(const fs::path& folder) { return file_exists((folder / "recording.yaml").string()); }

}  // namespace

bool holds_fleet(Database& database, const std::string& schema, const std::string& file) {
  if (database.count(fmt::format("SELECT count(*) FROM {}.sqlite_master", schema)) == 0) return false;
  const bool tables =
      database.count(fmt::format(
          "SELECT count(*) FROM {}.sqlite_master WHERE type = 'table' AND name IN ('meta', 'inputs', 'units')",
          schema)) == 3;
  if (!tables || !has_column(database, schema, "meta", "key") ||
      database.count(fmt::format(
          "SELECT count(*) FROM {}.meta WHERE key = 'format' AND value LIKE 'rangecal-fleet/%'", schema)) ==
          0)
    throw InputError(file, 0, "", "is no file of 'rangecal fleet'");
  return true;
}

void identify_inputs(Database& database) {
  add_column(database, "inputs", "identity", "TEXT");
  add_column(database, "units", "stamp", "INTEGER");
  add_column(database, "units", "contents", "INTEGER");
  add_column(database, "units", "notes", "TEXT");
  add_column(database, "units", "noise_shape", "TEXT");
  database.execute("CREATE INDEX IF NOT EXISTS identities ON inputs(identity)");
  std::vector<std::pair<std::string, std::string>> found;
  {
    Statement rows = database.prepare("SELECT name, identity FROM inputs ORDER BY name");
    while (rows.step()) {
      const std::string name = rows.text(0), identity = rows.text(1);
      if (!identity.empty() && file_exists(identity)) continue;
      const std::string now = identity_of(name);
      if (!now.empty()) found.emplace_back(name, now);
    }
  }
  Statement other = database.prepare("SELECT count(*) FROM inputs WHERE identity = ? AND name <> ?");
  Statement move = database.prepare("UPDATE inputs SET identity = ? WHERE name = ?");
  Statement drop_unit = database.prepare("DELETE FROM units WHERE name = ?"),
            drop = database.prepare("DELETE FROM inputs WHERE name = ?");
  for (const auto& [name, identity] : found) {
    other.bind(1, identity).bind(2, name).step();
    const bool twice = other.integer(0) > 0;
    other.run();
    if (twice) {
      drop_unit.bind(1, name).run();
      drop.bind(1, name).run();
    } else {
      move.bind(1, identity).bind(2, name).run();
    }
  }
}

void renew_fits(Database& database) {
  if (same_fits(database, "main")) return;
  database.execute("UPDATE units SET stamp = NULL, contents = NULL");
  database.prepare("INSERT OR REPLACE INTO meta VALUES('fit', ?)").bind(1, std::string(fit_version)).run();
}

void take_recordings(Database& database, const std::vector<std::string>& given) {
  // a name that another folder has already, of another working folder, gives way to the identity
  Statement insert = database.prepare(
      "INSERT INTO inputs(name, identity) SELECT CASE WHEN EXISTS(SELECT 1 FROM inputs WHERE name = ?1) THEN ?2 ELSE ?1 END, ?2"
      " WHERE NOT EXISTS(SELECT 1 FROM inputs WHERE identity = ?2)");
  const auto take = [&](const fs::path& folder) {
    const std::string name = folder.lexically_normal().string();
    insert.bind(1, name).bind(2, identity_of(name)).run();
  };
  for (const std::string& word : given) {
    const fs::path path = fs::path(word).lexically_normal();
    std::error_code error;
    if (!fs::is_directory(path, error))
      throw InputError(word, 0, "", "is no folder of a recording or of recordings");
    if (is_recording(path)) {
      take(path);
      continue;
    }
    bool any = false;
    // links after folders, in order: which of two names stays depends on nothing else
    std::vector<fs::path> links;
    for (const fs::directory_entry& entry : fs::directory_iterator(path)) {
      if (!entry.is_directory(error) || !is_recording(entry.path())) continue;
      any = true;
      if (entry.is_symlink(error))
        links.push_back(entry.path());
      else
        take(entry.path());
    }
    std::sort(links.begin(), links.end());
    for (const fs::path& link : links) take(link);
    if (!any) throw InputError(word, 0, "", "holds no recording");
  }
}

void merge_fleet(Database& database, const std::string& file) {
  if (!file_exists(file)) throw InputError(file, 0, "", "no such file");
  database.prepare("ATTACH ? AS other").bind(1, file).run();
  if (!holds_fleet(database, "other", file)) throw InputError(file, 0, "", "is no file of 'rangecal fleet'");
  if (database.count("SELECT count(*) FROM other.meta a JOIN main.meta b USING(key)"
                     " WHERE key IN ('format', 'order', 'law') AND a.value = b.value") != 3)
    throw InputError(file, 0, "", "was made with another order or noise law");
  if (database.count("SELECT count(*) FROM other.meta a JOIN main.meta b USING(key)"
                     " WHERE key = 'noise_shape' AND a.value <> b.value") > 0)
    throw InputError(file, 0, "", "was made with another noise shape");
  const bool early = !has_column(database, "other", "units", "contents"),
             noted = has_column(database, "other", "units", "notes"),
             shaped = has_column(database, "other", "units", "noise_shape");
  database.execute(fmt::format(
      "BEGIN;"
      "CREATE TEMP VIEW theirs AS SELECT *{}{}{} FROM other.units;"
      "CREATE TEMP VIEW places AS SELECT name, {} AS identity FROM other.inputs;"
      "INSERT OR IGNORE INTO main.inputs(name, identity) SELECT name, identity FROM places"
      " WHERE identity IS NULL OR identity NOT IN (SELECT identity FROM main.inputs WHERE identity IS NOT NULL);"
      "DELETE FROM main.units WHERE EXISTS(SELECT 1 FROM theirs WHERE theirs.name = units.name"
      " AND (units.readings IS NULL OR theirs.contents IS NOT NULL AND theirs.contents IS NOT units.contents));"
      "INSERT OR IGNORE INTO main.units SELECT * FROM theirs;"
      "{}"
      // units that they know by another name
      "UPDATE OR IGNORE main.units SET name = (SELECT inputs.name FROM places JOIN main.inputs USING(identity)"
      " WHERE places.name = units.name) WHERE name NOT IN (SELECT name FROM main.inputs);"
      "DELETE FROM main.units WHERE name NOT IN (SELECT name FROM main.inputs);"
      "DROP VIEW theirs; DROP VIEW places; COMMIT; DETACH other",
      early ? ", NULL AS stamp, NULL AS contents" : "", noted ? "" : ", NULL AS notes",
      shaped ? "" : ", NULL AS noise_shape",
      has_column(database, "other", "inputs", "identity") ? "identity" : "NULL",
      same_fits(database, "other")
          ? ""
          : "UPDATE main.units SET stamp = NULL, contents = NULL WHERE name IN (SELECT name FROM theirs);"));
}

std::string gone_in_words(const Changes& changes) {
  if (changes.gone == 0) return "";
  const bool one = changes.gone == 1, one_unrenewed = changes.gone_unrenewed == 1;
  std::string text = one ? changes.first_gone + " is gone from where it was read: what was found stands"
                         : fmt::format(
                               "{} units, {} the first of them, are gone from where they were read: what was "
                               "found stands",
                               changes.gone, changes.first_gone);
  if (changes.gone_unrenewed > 0)
    text += fmt::format("; {} fitted by an earlier version and cannot be fitted anew",
                        one             ? "it was"
                        : one_unrenewed ? "1 of them was"
                                        : fmt::format("{} of them were", changes.gone_unrenewed));
  return text;
}

Changes forget_changed(Database& database, const std::string& table) {
  struct Fitted {
    std::string name, identity;
    Fingerprint then, now;
    bool stamped = false;  ///< by this version
    bool gone = false;
  };
  constexpr int at_once = 4096;
  Changes changes;
  std::vector<Fitted> units;
  std::string after;
  do {
    units.clear();
    {
      Statement rows = database.prepare(
          fmt::format("SELECT u.name, i.identity, u.stamp, u.contents FROM {} u JOIN inputs i USING(name)"
                      " WHERE u.name > ? AND u.readings IS NOT NULL ORDER BY u.name LIMIT {}",
                      table, at_once));
      rows.bind(1, after);
      while (rows.step())
        units.push_back(
            {rows.text(0), rows.text(1), {rows.integer(2), rows.integer(3)}, {}, rows.number(2).has_value()});
    }
    tbb::parallel_for(std::size_t{0}, units.size(), [&](std::size_t i) {
      Fitted& unit = units[i];
      const std::string place = place_of(unit.name, unit.identity);
      unit.gone = !is_recording(place);
      if (unit.gone) return;
      unit.now = {stamp_of(place), unit.then.contents};
      if (unit.stamped && unit.now.stamp != unit.then.stamp) unit.now.contents = contents_of(place);
    });
    database.execute("BEGIN");
    for (const Fitted& unit : units) {
      if (unit.gone) {
        if (changes.gone++ == 0) changes.first_gone = unit.name;
        changes.gone_unrenewed += !unit.stamped;
      } else if (!unit.stamped || unit.now.contents != unit.then.contents) {
        database.prepare("DELETE FROM " + table + " WHERE name = ?").bind(1, unit.name).run();
        ++(unit.stamped ? changes.changed : changes.renewed);
      } else if (unit.now.stamp != unit.then.stamp) {
        database.prepare("UPDATE " + table + " SET stamp = ? WHERE name = ?")
            .bind(1, unit.now.stamp)
            .bind(2, unit.name)
            .run();
      }
    }
    database.execute("COMMIT");
    if (!units.empty()) after = units.back().name;
  } while (units.size() == at_once);
  return changes;
}

}  // namespace rangecal::app
