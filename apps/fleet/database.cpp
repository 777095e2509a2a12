// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/database.hpp"

#include <sqlite3.h>

#include <cmath>

#include "rangecal/core/errors.hpp"

namespace rangecal::app {

Statement::Statement(sqlite3* database, const std::string& file, const std::string& sql)
    : database_(database), file_(file) {
  if (::sqlite3_prepare_v2(database_, sql.c_str(), -1, &statement_, nullptr) != SQLITE_OK) fail();
}

Statement::~Statement() { ::sqlite3_finalize(statement_); }

void Statement::fail() const { throw InputError(file_ + ": " + ::sqlite3_errmsg(database_)); }

Statement& Statement::bind(int index, const std::string& text) {
  if (::sqlite3_bind_text(statement_, index, text.c_str(), static_cast<int>(text.size()), SQLITE_TRANSIENT) !=
      SQLITE_OK)
    fail();
  return *this;
}

Statement& Statement::bind(int index, double value) {
  const int code = std::isfinite(value) ? ::sqlite3_bind_double(statement_, index, value)
                                        : ::sqlite3_bind_null(statement_, index);
  if (code != SQLITE_OK) fail();
  return *this;
}

Statement& Statement::bind(int index, std::int64_t value) {
  if (::sqlite3_bind_int64(statement_, index, value) != SQLITE_OK) fail();
  return *this;
}

Statement& Statement::bind(int index, const Eigen::VectorXd& values) {
  const int bytes = static_cast<int>(values.size() * sizeof(double));
  const int code = bytes == 0
                       ? ::sqlite3_bind_null(statement_, index)
                       : ::sqlite3_bind_blob(statement_, index, values.data(), bytes, SQLITE_TRANSIENT);
  if (code != SQLITE_OK) fail();
  return *this;
}

bool Statement::step() {
  const int code = ::sqlite3_step(statement_);
  if (code != SQLITE_ROW && code != SQLITE_DONE) fail();
  return code == SQLITE_ROW;
}

void Statement::run() {
  while (step()) {
  }
  ::sqlite3_reset(statement_);
}

std::string Statement::text(int column) const {
  const auto* bytes = reinterpret_cast<const char*>(::sqlite3_column_text(statement_, column));
  return bytes ? std::string(bytes, static_cast<std::size_t>(::sqlite3_column_bytes(statement_, column)))
               : std::string();
}

std::optional<double> Statement::number(int column) const {
  if (::sqlite3_column_type(statement_, column) == SQLITE_NULL) return std::nullopt;
  return ::sqlite3_column_double(statement_, column);
}

std::int64_t Statement::integer(int column) const { return ::sqlite3_column_int64(statement_, column); }

Eigen::VectorXd Statement::vector(int column) const {
  const auto* values = static_cast<const double*>(::sqlite3_column_blob(statement_, column));
  const Eigen::Index size =
      ::sqlite3_column_bytes(statement_, column) / static_cast<Eigen::Index>(sizeof(double));
  return values ? Eigen::VectorXd(Eigen::VectorXd::Map(values, size)) : Eigen::VectorXd();
}

int Statement::columns() const { return ::sqlite3_column_count(statement_); }
std::string Statement::name(int column) const { return ::sqlite3_column_name(statement_, column); }

Database::Database(const std::string& file) : file_(file) {
  const int code =
      ::sqlite3_open_v2(file.c_str(), &database_, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  if (code != SQLITE_OK) {
    const std::string why = ::sqlite3_errmsg(database_);
    ::sqlite3_close(database_);
    throw InputError(file + ": " + why);
  }
  ::sqlite3_busy_timeout(database_, 60000);
}

Database::~Database() { ::sqlite3_close(database_); }

void Database::execute(const std::string& sql) {
  if (::sqlite3_exec(database_, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
    throw InputError(file_ + ": " + ::sqlite3_errmsg(database_));
}

std::int64_t Database::count(const std::string& sql) {
  Statement statement = prepare(sql);
  statement.step();
  return statement.integer(0);
}

}  // namespace rangecal::app
