# SPDX-License-Identifier: MIT
"""Work that is begun before its result is wanted, beside what the caller does."""
import threading


def ahead(function, *arguments):
    """Begin function(*arguments) in a thread; returns the function that waits for its value, or raises what it raised."""
    outcome = {}

    def work():
        try:
            outcome["value"] = function(*arguments)
        except BaseException as error:  # belongs to whoever asks for the value
            outcome["error"] = error

    thread = threading.Thread(target=work, daemon=True)
    thread.start()

    def result():
        thread.join()
        if "error" in outcome:
            raise outcome["error"]
        return outcome["value"]
    return result
