"""The operator's page: a process of its own, a client of the control socket and of nothing else.

`link` asks the daemon, `texts` holds every word that is shown, `server` puts the page together. What a frozen
process would leave on the screen is told by `assets/watchdog.js`, which needs nothing but the browser.
"""
