# Part of ./tribox: what the container sees of this machine, and what it can write there.
#
# Lists are strings with one path a line. A list of inputs and one of outputs are made from the words of
# the command line; list_mounts makes one list of mounts from them.
# shellcheck shell=sh
# shellcheck disable=SC2154,SC2034  # variables of ./tribox

# Directories that a container needs for itself.
is_system() {
    case $1 in
        / | /bin | /boot | /dev | /etc | /lib | /lib32 | /lib64 | /libx32 | /proc | /run | /sbin | \
            /sys | /usr | /usr/bin | /usr/lib | /usr/lib64 | /usr/local | /usr/local/bin | \
            /usr/sbin | /usr/share | /var | /var/cache | /var/lib) return 0 ;;
    esac
    return 1
}

# True if path $2 is in the list $1, or below a directory that is.
covered() {
    above=$2
    while [ -n "$above" ]; do
        case $newline$1 in
            *"$newline$above$newline"*) return 0 ;;
        esac
        above=${above%/*}
    done
    return 1
}

# Let path $1 be read, unless it is seen already.
add_input() {
    one_line "$1"
    is_system "$1" || covered "$inputs" "$1" || inputs=$inputs$1$newline
}

# Let directory $1, which is made if need be (then it is in `made`), be written: as it is called and
# as it is.
add_output() {
    if [ ! -e "$1" ]; then
        mkdir -p -- "$1" 2>/dev/null || die "$1: cannot be made"
        made=$1
    fi
    [ -d "$1" ] || return 0 # the program says what is wrong with it
    for way in -L -P; do
        directory_path "$1" "$way" || die "$1: cannot be entered"
        ! is_system "$path" || die "$path cannot be written from within a container: name a" \
            "directory of your own"
        case $newline$outputs in
            *"$newline$path$newline"*) ;;
            *) outputs=$outputs$path$newline ;;
        esac
    done
}

# The same for a results directory. One with other things in it stays as it is: the program
# refuses it.
add_results() {
    if [ -d "$1" ] && [ -n "$(ls -A -- "$1")" ]; then
        for name in case.toml summary.json log.txt history.csv tribox.lock friction_map.csv \
            fit.json verification.md ''; do
            [ -z "$name" ] || [ ! -e "$1/$name" ] || break
        done
        [ -n "$name" ] || return 0
    fi
    add_output "$1"
}

# Sets parent to the directory of path $1, as it is written.
parent_of() {
    case $1 in
        /*/*) parent=${1%/*} ;;
        /*) parent=/ ;;
        */*) parent=./${1%/*} ;;
        *) parent=. ;;
    esac
}

# Add what is needed to read path $1, which is there. A path through a symbolic link is added as
# it is called and as it is.
add_named() {
    real=$(readlink -f -- "$1" && echo x)
    real=${real%"${newline}x"}
    for named in "$1" "$real"; do
        if [ ! -d "$named" ]; then
            parent_of "$named"
            named=$parent
        fi
        ! directory_path "$named" -L || add_input "$path"
    done
}

# Add the files that case file $1 names relative to itself: of a mesh that file alone, of a law in
# Python and of a drawing the directory too, as what lies beside may be read.
add_files_of_case() {
    parent_of "$1"
    beside=$parent
    kinds='msh|geo|step|stp'
    names=$(grep -oiE "\"[^\"]*\.($kinds|py:[^\"]*)\"|'[^']*\.($kinds|py:[^']*)'" 2>/dev/null <"$1" |
        sed -e 's/^.//' -e 's/.$//' -e 's/\.py:.*/.py/')$newline
    while [ -n "$names" ]; do
        name=${names%%"$newline"*}
        names=${names#*"$newline"}
        case $name in
            '') continue ;;
            /*) ;;
            *) name=$beside/$name ;;
        esac
        case $name in
            *.[mM][sS][hH])
                parent_of "$name"
                if [ -f "$name" ] && directory_path "$parent" -L; then
                    add_input "$path/${name##*/}"
                fi
                ;;
            *) [ ! -f "$name" ] || add_named "$name" ;;
        esac
    done
}

# Add what the arguments of the command line name: files and directories that are there, also as
# the value of --option=value or key=value, and of file.py:Class.
add_arguments() {
    for value; do
        value=${value#*=}
        case $value in
            *.py:*) value=${value%:*} ;;
        esac
        if [ -e "$value" ]; then
            add_named "$value"
            if [ -f "$value" ] && [ "${value%.toml}" != "$value" ]; then add_files_of_case "$value"; fi
        fi
    done
}

# Sets command, first and second (the words after it that are no options) and out (--out).
read_words() {
    command='' first='' second='' out='' option='' ended=''
    for word; do
        [ "$command" != python ] || [ -z "$first" ] || break # the rest is the script's
        if [ -n "$option" ]; then
            [ "$option" != --out ] || out=$word
            option=''
            continue
        fi
        case $ended$word in
            --) ended=yes ;;
            --out=*) out=${word#--out=} ;;
            # Options with a value of their own.
            --out | --set | --np | --jobs | --part | --fix | --start | --case | --repeat | --field | \
                --inputs-of)
                option=$word
                ;;
            --help)
                command='' # it only talks
                return 0
                ;;
            -*) ;;
            *)
                if [ -z "$command" ]; then
                    command=$word
                elif [ -z "$first" ]; then
                    first=$word
                elif [ -z "$second" ]; then
                    second=$word
                fi
                ;;
        esac
    done
}

# Add the results directory of file $1, with its ending replaced by $2, if the file is there.
add_default_results() {
    [ -f "$1" ] || return 0
    name=${1##*/}
    case $name in
        ?*.*) name=${name%.*} ;;
    esac
    add_results "$results/$name$2"
}

# Add what the command writes, and no more.
add_outputs_of_command() {
    case $command in
        run) if [ -n "$out" ]; then add_results "$out"; else add_default_results "$first" ''; fi ;;
        map | fit)
            if [ -n "$out" ]; then
                add_results "$out"
            elif [ -n "$first" ]; then
                add_default_results "$first" "-$command"
            elif [ "$command" = map ]; then
                add_results "$results/built-in-map"
            fi
            ;;
        verify) [ -z "$out" ] || add_results "$out" ;;
        bench) [ -z "$out" ] || add_output "$out" ;;
        mesh)
            case $first in
                *.geo)
                    parent_of "${out:-$first}"
                    [ ! -f "$first" ] || add_output "$parent"
                    ;;
                *) if [ -n "$out" ]; then add_output "$out"; else add_default_results "$first" -mesh; fi ;;
            esac
            ;;
        plot) [ ! -d "$first" ] || add_results "$first" ;;
        report)
            if [ -n "$out" ]; then
                parent_of "$out"
                add_output "$parent"
            elif [ -d "$first" ]; then
                add_results "$first"
            fi
            ;;
        init)
            case $second in
                *.toml) if [ -d "$second" ]; then parent=$second; else parent_of "$second"; fi ;;
                *) parent=${second:-.} ;;
            esac
            add_output "$parent"
            ;;
        # A script is the user's own, started to do what it likes with the directory it is started in.
        python) add_output "$working" ;;
    esac
}

# Sets item to the first line of the list `rest`, and takes it out there; false at the end.
next_item() {
    [ -n "$rest" ] || return 1
    item=${rest%%"$newline"*}
    rest=${rest#*"$newline"}
}

# Add mode $1 (ro or rw) and path $2 to the mounts, unless the path is among them.
add_mount() {
    is_mounted "$2" || mounts=$mounts$1\ $2$newline
}

is_mounted() {
    case $newline$mounts in
        *"$newline"r[ow]" $1$newline"*) return 0 ;;
    esac
    return 1
}

# Sets mounts to what is written, what must stay as it is within that, and what is read.
list_mounts() {
    mounts=''
    rest=$outputs
    while next_item; do
        add_mount rw "$item"
        protect_program "$item"
    done
    rest=$inputs
    while next_item; do
        # A script may write beside its inputs.
        if [ "$command" != python ] || ! covered "$outputs" "$item"; then add_mount ro "$item"; fi
    done
    rest=$mounts
    while next_item; do add_mounts_below "${item%% *}" "${item#* }"; done
}

# Keep the program as it is where directory $1 is written.
protect_program() {
    protect "$root" "$1"
    for part in .ci .dockerignore .git Dockerfile app benchmarks cases docker docs forms geometry \
        pyproject.toml tests tribox; do
        case $part in
            benchmarks | cases | docs) ;;
            *) refuse_inside "$root/$part" "$1" "a part of the program" ;;
        esac
        if [ "$path" = "$root" ]; then protect "$root/$part" "$1"; fi
    done
}

# Keep $1 as it is if it lies in directory $2, which is written and may be called by another name.
protect() {
    directory_path "$2" -P
    case $1 in
        "$path"/*) [ ! -e "$1" ] || add_mount ro "$2${1#"$path"}" ;;
    esac
}

# Refuse to write directory $2 if it is $1, or lies in it; $3 says what that is.
refuse_inside() {
    directory_path "$2" -P
    case $path/ in
        "$1"/*) die "$2: is $3; name another directory" ;;
    esac
}

# What is mounted below a directory stays writable when that is mounted read-only: mount it too.
add_mounts_below() {
    [ "$1" = ro ] && [ -r /proc/self/mountinfo ] && directory_path "$2" -P || return 0
    while read -r _ _ _ _ point _; do
        case $point in
            "$path"/*) ;;
            *\\*) ;;
            *) continue ;;
        esac
        # Spaces and the like are written as \040.
        point=$(printf '%bx' "$(printf %s "$point" | sed 's/\\/\\0/g')")
        point=${point%x}
        case $point in
            "$path"/*) one_line "$point" ;;
            *) continue ;;
        esac
        point=$2${point#"$path"}
        if [ -e "$point" ] && nearest_is_read_only "$point"; then add_mount ro "$point"; fi
    done </proc/self/mountinfo
}

nearest_is_read_only() {
    above=${1%/*}
    while [ -n "$above" ]; do
        case $newline$mounts in
            *"${newline}ro $above$newline"*) return 0 ;;
            *"${newline}rw $above$newline"*) return 1 ;;
        esac
        above=${above%/*}
    done
    return 1
}
