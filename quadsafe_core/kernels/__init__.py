"""Compiled code: how kernels are compiled and kept, arrays they borrow, vector lanes, three-vectors."""
