"""Who may command from the page when it is reached over the network, and how much anyone may ask.

`password` is the file with its hash, `guard` the sessions and the lock-out, `doors` the limits of requests, `terms`
what the cell file says of it. None of them imports the rest of the page but its texts; `password` needs the standard
library only, since `vgrd page-password` makes the file.
"""
