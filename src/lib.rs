//! kinelm.
