"""The parent process: serves the registers, supervises the others, talks to systemd."""
