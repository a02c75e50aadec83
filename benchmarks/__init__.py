"""Measurements that anyone can repeat: ratios against peers, and what comes out on real trees."""
