"""Run against run: what one version of a method gains and loses against another."""
