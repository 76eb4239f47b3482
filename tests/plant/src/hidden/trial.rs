//! Putting the program through a case, as a user would.
