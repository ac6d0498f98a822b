MODULE Vgrd
  ! vgrd on an ABB controller (IRC5, OmniCore) over the line server: docs/line-server.md.
  !
  ! FRAGMENT. Not run on hardware, nor in RobotStudio.
  ! Checked by machine: grammar (rapidchecker); executed line by line, with stand-ins for the controller's own
  ! instructions, against the whole decision table (docs/robot-programs.md) and each fault of its rows.
  !
  ! Load it into both tasks: the motion task calls VgrdGo, a semistatic background task has VgrdWatch as its main
  ! entry. The words LINK, HEARTBEAT, ... are those of the decision table.
  ! Poses are of the flange (tool0) in the base (wobj0). vgrd is not a safety function.

  ! 1 ADDRESS: the cell computer, and line_port of its cell file.
  CONST string VGRD_HOST := "192.168.10.5";
  CONST num VGRD_PORT := 1503;

  ! 2 REQUEST: STATUS 2 (degraded) only where it is precise enough. The point: VgrdExample.
  CONST bool VGRD_DEGRADED_OK := FALSE;

  ! 3 TAUGHT: in VgrdExample, at the beginning of the motion task.

  ! 4 LIMITS: as in docs/robot-programs.md, which says why; the box is of the flange in the base, mm.
  CONST num VGRD_MIN_X := 300;
  CONST num VGRD_MAX_X := 700;
  CONST num VGRD_MIN_Y := -300;
  CONST num VGRD_MAX_Y := 300;
  CONST num VGRD_MIN_Z := 50;
  CONST num VGRD_MAX_Z := 500;
  CONST num VGRD_STEP_MM := 50;
  CONST num VGRD_STEP_DEG := 20;
  CONST num VGRD_APPROACH_MM := 50;
  CONST num VGRD_AGE_MS := 1000;
  CONST num VGRD_U95_UM := 1000;
  CONST num VGRD_LINK_S := 0.2;
  CONST num VGRD_HEARTBEAT_S := 0.5;
  CONST num VGRD_ANSWER_S := 3;
  CONST num VGRD_POLL_S := 0.05;
  CONST num VGRD_AGREE_MM := 0.5;
  CONST num VGRD_AGREE_DEG := 0.5;
  CONST num VGRD_ATTEMPTS := 3;
  CONST num VGRD_PAUSE_S := 0.5;

  ! 5 MOTION: speeds to the approach point, and in the last leg.
  CONST speeddata VGRD_FAST := v100;
  CONST speeddata VGRD_SLOW := v50;

  ! From here to VgrdExample nothing is to be edited.

  ! The decisions of docs/robot-programs.md; 0: all hold, use it.
  CONST num VGRD_USE := 0;
  CONST num VGRD_LINK := 1;
  CONST num VGRD_HEARTBEAT := 3;
  CONST num VGRD_ECHO := 5;
  CONST num VGRD_STATUS := 7;
  CONST num VGRD_SENTINEL := 10;
  CONST num VGRD_AGE := 11;
  CONST num VGRD_U95 := 12;
  CONST num VGRD_BOX := 13;
  CONST num VGRD_STEP := 14;
  CONST num VGRD_REACH := 15;
  CONST num VGRD_APPROACH := 16;
  CONST num VGRD_ASK_AGAIN := 17;
  CONST num VGRD_POLL := 18;

  ! What the two tasks tell each other.
  PERS num vgrdAsk := 0;
  PERS num vgrdPoint := 1;
  PERS num vgrdDone := 0;
  PERS num vgrdDoneWord := 0;
  PERS bool vgrdDoneAgain := FALSE;
  PERS num vgrdStatus := 0;
  PERS num vgrdTaskBeat := 1;
  PERS bool vgrdLost := TRUE;
  PERS robtarget vgrdTaught := [[500,0,200],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PERS robtarget vgrdTarget := [[500,0,200],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];

  ! Of the background task.
  CONST num VGRD_IDLE := 0;
  CONST num VGRD_WAITING := 1;
  CONST num VGRD_VALID := 2;
  VAR num vgrdState := 0;
  VAR num vgrdAsked := 0;
  VAR num vgrdTrig := 0;
  VAR socketdev vgrdSocket;
  VAR bool vgrdOpen := FALSE;
  VAR bool vgrdGood := FALSE;
  VAR bool vgrdWhole := FALSE;
  VAR string vgrdLine := "";
  VAR string vgrdPart := "";
  VAR num vgrdField{11} := [0,0,0,0,0,0,0,0,0,0,0];
  VAR num vgrdCount := 0;
  VAR num vgrdAt := 1;
  VAR num vgrdComma := 1;
  VAR num vgrdNumber := 0;
  VAR num vgrdLastBeat := -1;
  VAR bool vgrdBeatSeen := FALSE;
  VAR bool vgrdPasses := FALSE;
  VAR clock vgrdBeatClock;
  VAR clock vgrdAskClock;
  VAR robtarget vgrdNew;

  ! Of the motion task.
  VAR num vgrdWord := 0;
  VAR bool vgrdAgain := FALSE;
  VAR bool vgrdArrived := FALSE;
  VAR bool vgrdReached := FALSE;
  VAR bool vgrdLate := FALSE;
  VAR num vgrdTry := 0;
  VAR num vgrdBeatBefore := 0;
  VAR num vgrdSame := 1;
  VAR robtarget vgrdClear;
  VAR robtarget vgrdApproach;
  VAR robtarget vgrdFirst;
  VAR robtarget vgrdFound;
  VAR pos vgrdHere;
  VAR jointtarget vgrdJoints;

  ! ---------------------------------------------------------------- motion task

  ! 3 TAUGHT: a point of the cell file, and the flange at the touch, taken there by hand with tool0 and wobj0.
  PROC VgrdExample()
    CONST robtarget taughtP1 := [[500,0,200],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
    VgrdGo 1, taughtP1;
  ENDPROC

  ! Takes the flange to the expected coordinate of a point. Returns there, and only there.
  PROC VgrdGo(num point, robtarget taught)
    vgrdPoint := point;
    vgrdTaught := taught;
    vgrdClear := RelTool(taught, 0, 0, -VGRD_APPROACH_MM);
    vgrdArrived := FALSE;
    vgrdTry := 0;
    WHILE NOT vgrdArrived DO
      vgrdTry := vgrdTry + 1;
      VgrdOnce;
      IF NOT vgrdArrived THEN
        VgrdReact;
      ENDIF
    ENDWHILE
  ENDPROC

  ! Asks, goes to the approach point, asks again, goes the last leg.
  PROC VgrdOnce()
    MoveJ vgrdClear, VGRD_FAST, fine, tool0\WObj:=wobj0;
    VgrdAskFor;
    IF vgrdWord <> VGRD_USE THEN
      RETURN;
    ENDIF
    vgrdFirst := vgrdTarget;
    vgrdApproach := RelTool(vgrdFirst, 0, 0, -VGRD_APPROACH_MM);
    VgrdReach vgrdFirst;
    VgrdReach vgrdApproach;
    IF vgrdWord <> VGRD_USE THEN
      RETURN;
    ENDIF
    VgrdLeg vgrdApproach, VGRD_FAST;
    IF vgrdWord <> VGRD_USE THEN
      RETURN;
    ENDIF
    ! A refused answer leaves vgrdTarget as it was: then the two agree, and its word stays.
    VgrdAskFor;
    VgrdAgree;
    IF vgrdWord <> VGRD_USE THEN
      RETURN;
    ENDIF
    VgrdReach vgrdTarget;
    IF vgrdWord <> VGRD_USE THEN
      RETURN;
    ENDIF
    VgrdLeg vgrdTarget, VGRD_SLOW;
    IF vgrdWord <> VGRD_USE THEN
      MoveL vgrdApproach, VGRD_SLOW, fine, tool0\WObj:=wobj0;
      RETURN;
    ENDIF
    vgrdArrived := TRUE;
  ENDPROC

  ! Asks again where that helps, else stops until somebody presses the start key.
  PROC VgrdReact()
    IF vgrdAgain THEN
      IF vgrdTry < VGRD_ATTEMPTS THEN
        WaitTime VGRD_PAUSE_S;
        RETURN;
      ENDIF
    ENDIF
    TPWrite "vgrd: decision " + NumToStr(vgrdWord, 0) + ", STATUS " + NumToStr(vgrdStatus, 0);
    TPWrite "see docs/robot-programs.md; the start key asks anew";
    Stop;
    vgrdTry := 0;
  ENDPROC

  ! Has the background task ask, and waits for what it decided. vgrdAsk outlives a restart, and a num holds no whole
  ! number beyond 2^24: it begins anew long before.
  PROC VgrdAskFor()
    vgrdAsk := vgrdAsk MOD 30000 + 1;
    vgrdLate := FALSE;
    WaitUntil vgrdDone = vgrdAsk\MaxTime:=VGRD_ANSWER_S + 3\TimeFlag:=vgrdLate;
    vgrdWord := vgrdDoneWord;
    vgrdAgain := vgrdDoneAgain;
    IF vgrdLate THEN
      vgrdWord := VGRD_LINK;
      vgrdAgain := FALSE;
    ENDIF
  ENDPROC

  PROC VgrdReach(robtarget place)
    vgrdJoints := CalcJointT(place, tool0\WObj:=wobj0);
  ERROR
    vgrdWord := VGRD_REACH;
    vgrdAgain := FALSE;
    RETURN;
  ENDPROC

  ! The second answer is the first, give or take.
  PROC VgrdAgree()
    IF Distance(vgrdTarget.trans, vgrdFirst.trans) > VGRD_AGREE_MM THEN
      vgrdWord := VGRD_ASK_AGAIN;
      vgrdAgain := TRUE;
    ENDIF
    VgrdCompare vgrdTarget, vgrdFirst;
    IF vgrdSame < Cos(VGRD_AGREE_DEG / 2) THEN
      vgrdWord := VGRD_ASK_AGAIN;
      vgrdAgain := TRUE;
    ENDIF
  ENDPROC

  ! vgrdSame becomes the cosine of half the turn between two poses.
  PROC VgrdCompare(robtarget one, robtarget other)
    vgrdSame := one.rot.q1 * other.rot.q1 + one.rot.q2 * other.rot.q2;
    vgrdSame := vgrdSame + one.rot.q3 * other.rot.q3 + one.rot.q4 * other.rot.q4;
    vgrdSame := Abs(vgrdSame);
  ENDPROC

  ! Goes straight to `place` and stops when the answer ends. The background task must be alive before.
  ! A search that finds nothing has come to its end: that is the good case here.
  PROC VgrdLeg(robtarget place, speeddata speed)
    vgrdReached := FALSE;
    vgrdBeatBefore := vgrdTaskBeat;
    vgrdLate := FALSE;
    WaitUntil vgrdTaskBeat <> vgrdBeatBefore\MaxTime:=VGRD_HEARTBEAT_S\TimeFlag:=vgrdLate;
    vgrdWord := VGRD_POLL;
    vgrdAgain := FALSE;
    IF vgrdLate THEN
      vgrdWord := VGRD_LINK;
      RETURN;
    ENDIF
    VgrdSearch place, speed;
    IF vgrdReached THEN
      VgrdThere place;
    ENDIF
  ENDPROC

  ! The arm stands where it was sent: something else may have ended its motion.
  PROC VgrdThere(robtarget sent)
    vgrdWord := VGRD_USE;
    vgrdHere := CPos(\Tool:=tool0\WObj:=wobj0);
    IF Distance(vgrdHere, sent.trans) > VGRD_AGREE_MM THEN
      vgrdWord := VGRD_APPROACH;
    ENDIF
  ENDPROC

  PROC VgrdSearch(robtarget goal, speeddata pace)
    SearchL\SStop, vgrdLost, vgrdFound, goal, pace, tool0\WObj:=wobj0;
  ERROR
    IF ERRNO = ERR_WHLSEARCH THEN
      vgrdReached := TRUE;
    ENDIF
    RETURN;
  ENDPROC

  ! ------------------------------------------------------------ background task

  ! Main entry of the background task.
  PROC VgrdWatch()
    VgrdSetup;
    WHILE TRUE DO
      VgrdTurn;
      WaitTime VGRD_POLL_S;
    ENDWHILE
  ENDPROC

  ! What was asked before a restart is not asked again, and its answer stands no more.
  PROC VgrdSetup()
    vgrdLost := TRUE;
    vgrdAsked := vgrdAsk;
  ENDPROC

  ! One turn: a request where one is wanted, else the question whether the answer still stands.
  PROC VgrdTurn()
    vgrdTaskBeat := (vgrdTaskBeat + 1) MOD 10000;
    IF vgrdAsk <> vgrdAsked THEN
      VgrdBegin;
    ENDIF
    IF vgrdState = VGRD_IDLE THEN
      RETURN;
    ENDIF
    VgrdExchange;
    VgrdDecide;
  ENDPROC

  ! A connection for each request: one that was silent for a minute is closed, and nothing old is in a new one.
  PROC VgrdBegin()
    vgrdLost := TRUE;
    vgrdOpen := FALSE;
    vgrdAsked := vgrdAsk;
    vgrdTrig := vgrdTrig MOD 65535 + 1;
    vgrdStatus := 0;
    vgrdLastBeat := -1;
    vgrdBeatSeen := FALSE;
    ClkReset vgrdBeatClock;
    ClkStart vgrdBeatClock;
    ClkReset vgrdAskClock;
    ClkStart vgrdAskClock;
    vgrdState := VGRD_WAITING;
  ENDPROC

  ! Tells the motion task what was decided. Any decision ends the answer.
  PROC VgrdRefuse(num word, bool again)
    IF vgrdState = VGRD_WAITING THEN
      vgrdDoneWord := word;
      vgrdDoneAgain := again;
      vgrdDone := vgrdAsked;
    ENDIF
    vgrdState := VGRD_IDLE;
    vgrdLost := TRUE;
  ENDPROC

  ! From what was read to a decision, in the order of the decision table.
  PROC VgrdDecide()
    IF NOT vgrdGood THEN
      VgrdRefuse VGRD_LINK, FALSE;
      RETURN;
    ENDIF
    IF vgrdField{4} <> vgrdLastBeat THEN
      VgrdHeard;
    ENDIF
    IF ClkRead(vgrdBeatClock) > VGRD_HEARTBEAT_S THEN
      VgrdRefuse VGRD_HEARTBEAT, FALSE;
      RETURN;
    ENDIF
    IF vgrdState = VGRD_VALID THEN
      VgrdStill;
      RETURN;
    ENDIF
    IF ClkRead(vgrdAskClock) > VGRD_ANSWER_S THEN
      VgrdRefuse VGRD_ECHO, TRUE;
      RETURN;
    ENDIF
    IF vgrdField{1} <> vgrdTrig THEN
      RETURN;
    ENDIF
    IF vgrdField{2} = 10 THEN
      RETURN;
    ENDIF
    VgrdAccept;
  ENDPROC

  ! HB has changed; at the first line of a request it is only noted.
  PROC VgrdHeard()
    IF vgrdLastBeat >= 0 THEN
      vgrdBeatSeen := TRUE;
    ENDIF
    vgrdLastBeat := vgrdField{4};
    ClkReset vgrdBeatClock;
    ClkStart vgrdBeatClock;
  ENDPROC

  ! While the arm moves: the answer stands as when it was accepted.
  PROC VgrdStill()
    vgrdStatus := vgrdField{2};
    IF vgrdField{1} <> vgrdTrig THEN
      VgrdRefuse VGRD_POLL, FALSE;
      RETURN;
    ENDIF
    VgrdJudgeStatus;
  ENDPROC

  PROC VgrdJudgeStatus()
    IF vgrdStatus = 1 THEN
      RETURN;
    ENDIF
    IF vgrdStatus = 2 THEN
      IF VGRD_DEGRADED_OK THEN
        RETURN;
      ENDIF
    ENDIF
    VgrdJudgePassing;
    VgrdRefuse VGRD_STATUS, vgrdPasses;
  ENDPROC

  ! What passes by itself: ask again.
  PROC VgrdJudgePassing()
    vgrdPasses := FALSE;
    IF vgrdStatus = 0 vgrdPasses := TRUE;
    IF vgrdStatus = 106 vgrdPasses := TRUE;
    IF vgrdStatus = 201 vgrdPasses := TRUE;
    IF vgrdStatus = 202 vgrdPasses := TRUE;
    IF vgrdStatus = 205 vgrdPasses := TRUE;
    IF vgrdStatus = 206 vgrdPasses := TRUE;
    IF vgrdStatus = 302 vgrdPasses := TRUE;
    IF vgrdStatus = 401 vgrdPasses := TRUE;
    IF vgrdStatus = 403 vgrdPasses := TRUE;
    IF vgrdStatus = 900 vgrdPasses := TRUE;
    IF vgrdStatus = 901 vgrdPasses := TRUE;
  ENDPROC

  PROC VgrdAccept()
    vgrdStatus := vgrdField{2};
    VgrdJudgeStatus;
    IF vgrdState = VGRD_IDLE THEN
      RETURN;
    ENDIF
    IF Abs(vgrdField{5}) > 99998 THEN
      VgrdRefuse VGRD_SENTINEL, FALSE;
      RETURN;
    ENDIF
    IF Abs(vgrdField{6}) > 99998 THEN
      VgrdRefuse VGRD_SENTINEL, FALSE;
      RETURN;
    ENDIF
    IF Abs(vgrdField{7}) > 99998 THEN
      VgrdRefuse VGRD_SENTINEL, FALSE;
      RETURN;
    ENDIF
    IF Abs(vgrdField{8}) > 998 THEN
      VgrdRefuse VGRD_SENTINEL, FALSE;
      RETURN;
    ENDIF
    IF Abs(vgrdField{9}) > 998 THEN
      VgrdRefuse VGRD_SENTINEL, FALSE;
      RETURN;
    ENDIF
    IF Abs(vgrdField{10}) > 998 THEN
      VgrdRefuse VGRD_SENTINEL, FALSE;
      RETURN;
    ENDIF
    IF vgrdField{3} > VGRD_AGE_MS THEN
      VgrdRefuse VGRD_AGE, TRUE;
      RETURN;
    ENDIF
    IF vgrdField{11} > VGRD_U95_UM THEN
      VgrdRefuse VGRD_U95, FALSE;
      RETURN;
    ENDIF
    IF NOT vgrdBeatSeen THEN
      RETURN;
    ENDIF
    VgrdPlace;
  ENDPROC

  ! Box and step, then the coordinate is handed over.
  PROC VgrdPlace()
    vgrdNew := vgrdTaught;
    vgrdNew.trans.x := vgrdField{5};
    vgrdNew.trans.y := vgrdField{6};
    vgrdNew.trans.z := vgrdField{7};
    vgrdNew.rot := OrientZYX(vgrdField{10}, vgrdField{9}, vgrdField{8});
    IF vgrdNew.trans.x < VGRD_MIN_X THEN
      VgrdRefuse VGRD_BOX, FALSE;
      RETURN;
    ENDIF
    IF vgrdNew.trans.x > VGRD_MAX_X THEN
      VgrdRefuse VGRD_BOX, FALSE;
      RETURN;
    ENDIF
    IF vgrdNew.trans.y < VGRD_MIN_Y THEN
      VgrdRefuse VGRD_BOX, FALSE;
      RETURN;
    ENDIF
    IF vgrdNew.trans.y > VGRD_MAX_Y THEN
      VgrdRefuse VGRD_BOX, FALSE;
      RETURN;
    ENDIF
    IF vgrdNew.trans.z < VGRD_MIN_Z THEN
      VgrdRefuse VGRD_BOX, FALSE;
      RETURN;
    ENDIF
    IF vgrdNew.trans.z > VGRD_MAX_Z THEN
      VgrdRefuse VGRD_BOX, FALSE;
      RETURN;
    ENDIF
    IF Distance(vgrdNew.trans, vgrdTaught.trans) > VGRD_STEP_MM THEN
      VgrdRefuse VGRD_STEP, FALSE;
      RETURN;
    ENDIF
    VgrdCompare vgrdNew, vgrdTaught;
    IF vgrdSame < Cos(VGRD_STEP_DEG / 2) THEN
      VgrdRefuse VGRD_STEP, FALSE;
      RETURN;
    ENDIF
    vgrdTarget := vgrdNew;
    vgrdState := VGRD_VALID;
    vgrdDoneWord := VGRD_USE;
    vgrdDoneAgain := FALSE;
    vgrdLost := FALSE;
    vgrdDone := vgrdAsked;
  ENDPROC

  ! --------------------------------------------------------- I/O, background task

  ! One question, one answer; vgrdGood tells whether all eleven numbers were read.
  PROC VgrdExchange()
    vgrdGood := FALSE;
    IF NOT vgrdOpen THEN
      VgrdConnect;
    ENDIF
    IF vgrdOpen THEN
      VgrdTalk;
    ENDIF
    IF vgrdWhole THEN
      VgrdParse;
    ENDIF
  ENDPROC

  PROC VgrdConnect()
    vgrdWhole := FALSE;
    SocketClose vgrdSocket;
    SocketCreate vgrdSocket;
    SocketConnect vgrdSocket, VGRD_HOST, VGRD_PORT\Time:=2;
    vgrdOpen := TRUE;
  ERROR
    RETURN;
  ENDPROC

  ! A receive may hold half a line: it is collected up to LF. OPT 16: roll, pitch, yaw.
  PROC VgrdTalk()
    vgrdWhole := FALSE;
    vgrdLine := "EC," + NumToStr(vgrdPoint, 0) + "," + NumToStr(vgrdTrig, 0) + ",2,0,16\0A";
    SocketSend vgrdSocket\Str:=vgrdLine;
    vgrdLine := "";
    WHILE NOT vgrdWhole DO
      SocketReceive vgrdSocket\Str:=vgrdPart\Time:=VGRD_LINK_S;
      vgrdLine := vgrdLine + vgrdPart;
      vgrdWhole := StrMatch(vgrdLine, 1, "\0A") <= StrLen(vgrdLine);
    ENDWHILE
  ERROR
    vgrdOpen := FALSE;
    RETURN;
  ENDPROC

  PROC VgrdParse()
    vgrdLine := StrPart(vgrdLine, 1, StrLen(vgrdLine) - 1);
    vgrdAt := 1;
    vgrdCount := 0;
    WHILE vgrdCount < 11 DO
      IF vgrdAt > StrLen(vgrdLine) THEN
        RETURN;
      ENDIF
      vgrdComma := StrMatch(vgrdLine, vgrdAt, ",");
      vgrdPart := StrPart(vgrdLine, vgrdAt, vgrdComma - vgrdAt);
      IF NOT StrToVal(vgrdPart, vgrdNumber) THEN
        RETURN;
      ENDIF
      vgrdCount := vgrdCount + 1;
      vgrdField{vgrdCount} := vgrdNumber;
      vgrdAt := vgrdComma + 1;
    ENDWHILE
    vgrdGood := vgrdAt > StrLen(vgrdLine);
  ENDPROC
ENDMODULE
