"""The outside world's files, sentences and buses."""
