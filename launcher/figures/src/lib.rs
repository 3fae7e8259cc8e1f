//! Pictures and result files: figures as SVG and PNG, tables as text, CSV and Parquet, pages as HTML.

pub mod figure;
pub mod results;
