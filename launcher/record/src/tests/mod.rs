mod fields;
mod file;
mod trouble;
