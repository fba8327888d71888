#pragma once
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "config/error.h"

namespace overfly::capture {

// A table with named columns: commas, optional double quotes, one header line, \n or \r\n. Cells are text.
class CsvTable {
 public:
  // BadInput: no header, or a column named twice.
  [[nodiscard]] static Result<CsvTable> parse(std::string_view text);

  [[nodiscard]] bool has(const std::string& column) const { return columns_.contains(column); }
  [[nodiscard]] std::size_t rows() const { return rows_.size(); }
  // Line of the file that a row stands on, from 1.
  [[nodiscard]] std::size_t lineOf(std::size_t row) const { return rows_[row].line; }
  // False: the row has more or fewer cells than the header.
  [[nodiscard]] bool complete(std::size_t row) const { return rows_[row].cells.size() == columns_.size(); }
  // nullopt: no such column, or the row has no such cell.
  [[nodiscard]] std::optional<std::string> text(std::size_t row, const std::string& column) const;
  // nullopt: as above, empty, not a number as a whole, or not finite.
  [[nodiscard]] std::optional<double> number(std::size_t row, const std::string& column) const;
  [[nodiscard]] std::optional<std::int64_t> integer(std::size_t row, const std::string& column) const;

 private:
  struct Row {
    std::size_t line = 0;
    std::vector<std::string> cells;
  };
  std::map<std::string, std::size_t> columns_;
  std::vector<Row> rows_;
};

}  // namespace overfly::capture
