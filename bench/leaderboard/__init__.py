"""Results that travel: one file a method and task, made by `bench submit` and checked by `bench verify`."""
