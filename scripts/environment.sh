# Sourced by scripts/run, scripts/test and scripts/docs: creates the virtual environment .venv beside pyproject.toml if needed.

root="$(cd -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.." && pwd -P)"
venv="$root/.venv"

# Minor versions of Python 3 for which Pinocchio and coal have wheels. The user's python3 is tried first.
newest_minor=14
oldest_minor=10

# A sourced ROS workspace puts another pinocchio first on PYTHONPATH.
unset PYTHONPATH PYTHONHOME

say() { printf 'pinproof: %s\n' "$*" >&2; }

# Print the name of a Python that can create the environment; otherwise explain what is missing.
find_python() {
    local minor candidate without_venv=""
    local candidates=(python3)
    for ((minor = newest_minor; minor >= oldest_minor; minor--)); do candidates+=("python3.$minor"); done
    for candidate in "${candidates[@]}"; do
        # Run each candidate: version managers put commands on the PATH that only print an error.
        "$candidate" -c "import sys; sys.exit(not (3, $oldest_minor) <= sys.version_info[:2] <= (3, $newest_minor))" \
            2>/dev/null || continue
        if "$candidate" -c "import ensurepip, venv" 2>/dev/null; then
            printf '%s\n' "$candidate"
            return
        fi
        without_venv="${without_venv:-$candidate}"
    done
    if [[ -n "$without_venv" ]]; then
        say "$without_venv lacks the venv module; on Debian and Ubuntu: sudo apt-get install python3-venv"
    else
        say "no Python 3.$oldest_minor to 3.$newest_minor found on the PATH; install one and repeat the command"
    fi
    return 1
}

# Hash of what is installed: the folder of the checkout, the extra ("", "docs" or "test") and pyproject.toml.
fingerprint() { { printf '%s\n' "$root" "$1"; cat -- "$root/pyproject.toml"; } | sha256sum | cut -d' ' -f1; }

is_current() {
    local stamp="$venv/.installed-${1:-plain}"
    [[ -x "$venv/bin/python" && -f "$stamp" && "$(<"$stamp")" == "$(fingerprint "$1")" ]]
}

install_into_venv() {
    local extra="$1" python
    if ! "$venv/bin/python" -c "" 2>/dev/null; then
        python="$(find_python)" || return 1
        "$python" -m venv --clear "$venv" >&2 || return 1
    fi
    # An interrupted first run leaves an environment without pip.
    "$venv/bin/python" -m pip --version >/dev/null 2>&1 || "$venv/bin/python" -m ensurepip >/dev/null || return 1
    # Modules are compiled to bytecode when they are first imported, which most never are.
    local pip=("$venv/bin/python" -m pip install -qq --disable-pip-version-check --no-compile)
    local tools compiling="" installed=0
    if ! core_is_current; then # compile it while the other packages are installed
        read -ra tools < <(sed -n 's/^core = \[\(.*\)\].*/\1/p' "$root/pyproject.toml" | tr -d '",')
        "${pip[@]}" "${tools[@]}" >&2 || return 1
        compile_core &
        compiling=$!
    fi
    # Only the Python part is installed here; scripts/build compiles the core into the source tree.
    "${pip[@]}" --config-settings wheel.cmake=false --config-settings wheel.py-api=py3 \
        --config-settings editable.mode=inplace --editable "$root[core${extra:+,$extra}]" >&2 || installed=1
    if [[ -n "$compiling" ]] && ! wait "$compiling"; then
        say "the core could not be compiled; see the lines above"
        return 1
    fi
    if ((installed != 0)); then return 1; fi
    # Newer versions of scikit-build-core install a finder that comes before PYTHONPATH, and so before a copy of the package
    # with another core, such as a checked one.
    local path
    for path in "$venv"/lib/python*/site-packages/_editable_*pinproof.pth; do
        if [[ -f "$path" ]]; then printf '%s\n' "$root/src" >"$path"; fi
    done
    fingerprint "" >"$venv/.installed-plain"
    if [[ -n "$extra" ]]; then fingerprint "$extra" >"$venv/.installed-$extra"; fi
}

# Whether the core was compiled for this environment after the last change of its sources.
core_is_current() {
    local stamp="$venv/.core-compiled"
    [[ -f "$stamp" && -z "$(find "$root/src/core" "$root/scripts/build" -newer "$stamp" -print -quit)" ]] &&
        compgen -G "$root/src/pinproof/_core.*.so" >/dev/null
}

compile_core() {
    local log="$venv/core-build.log"
    touch "$venv/.core-started" # a change during the compilation makes the result out of date
    if ! "$root/scripts/build" "$venv/bin/python" >"$log"; then
        cat -- "$log" >&2
        return 1
    fi
    mv -- "$venv/.core-started" "$venv/.core-compiled"
}

# prepare_venv [EXTRA]: install pinproof with the extra into .venv and compile the core, unless both are up to date.
prepare_venv() {
    local extra="${1:-}"
    if is_current "$extra" && core_is_current; then return; fi
    (
        flock 9 # if several first runs start together, one installs and the others wait
        if ! is_current "$extra"; then
            say "installing pinproof${extra:+[$extra]} into .venv and compiling its core; this takes about a minute ..."
            install_into_venv "$extra" || { say "the installation failed; see the lines above"; exit 1; }
        fi
        if ! core_is_current; then
            say "compiling the core, which takes about half a minute ..."
            compile_core || { say "the core could not be compiled; see the lines above"; exit 1; }
        fi
    ) 9>"$root/.venv.lock"
}
