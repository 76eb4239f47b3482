//! An independent numeric plant that makes test data; shares no code with codegen.
