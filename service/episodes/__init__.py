"""Episodes: records, replays, explanations, drives again."""
