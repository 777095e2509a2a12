// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

struct sqlite3;
struct sqlite3_stmt;

namespace rangecal::app {

/// One SQL statement; bound from 1, columns from 0. Failures throw InputError naming the file.
class Statement {
 public:
  Statement(sqlite3* database, const std::string& file, const std::string& sql);
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;
  ~Statement();

  Statement& bind(int index, const std::string& text);
  Statement& bind(int index, double value);  ///< NULL where it is not finite
  Statement& bind(int index, std::int64_t value);
  Statement& bind(int index, const Eigen::VectorXd& values);  ///< as a blob; NULL where it is empty
  bool step();                                                ///< true: a row is there
  void run();                                                 ///< to its end, ready to be bound again

  std::string text(int column) const;
  std::optional<double> number(int column) const;
  std::int64_t integer(int column) const;
  Eigen::VectorXd vector(int column) const;
  int columns() const;
  std::string name(int column) const;

 private:
  [[noreturn]] void fail() const;
  sqlite3* database_;
  std::string file_;
  sqlite3_stmt* statement_ = nullptr;
};

/// An SQLite file: journalled, so that a kill leaves the last transaction whole or out.
class Database {
 public:
  explicit Database(const std::string& file);
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;
  ~Database();

  void execute(const std::string& sql);
  Statement prepare(const std::string& sql) { return {database_, file_, sql}; }
  std::int64_t count(const std::string& sql);  ///< the whole number that a query of one row and column gives
  const std::string& file() const { return file_; }

 private:
  std::string file_;
  sqlite3* database_ = nullptr;
};

}  // namespace rangecal::app
