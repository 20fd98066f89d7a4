"""Readers, writers, pictures, movies and session files."""
